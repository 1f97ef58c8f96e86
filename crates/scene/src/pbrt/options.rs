//! Directives before `WorldBegin`: camera, film, pixel filter, sampler, integrator.

use super::directive::Directive;
use super::params::{Params, Type};
use super::reader::Reader;
use super::tokens::shown;
use super::version::Version;
use crate::{Camera, PixelFilter, Projection, Source};

impl Reader<'_> {
    /// Executes `Camera`, `Film`, `Sampler`, `Integrator` or `PixelFilter`.
    pub(super) fn read_rendering_option(&mut self, mut d: Directive<'_>) {
        let params = self.params(&mut d, "");
        let (kind, source) = (d.texts.swap_remove(0), d.source);
        self.meet(d.word, &source);
        match d.word {
            "Camera" => self.read_camera(&kind, source, params),
            "Film" => self.read_film(&kind, &source, params),
            "Sampler" => self.read_sampler(params),
            "Integrator" => self.read_integrator(&kind, &source, params),
            _ => self.read_filter(&kind, &source, params),
        }
    }

    /// Adds a notice if a pbrt-v2 file names no `SurfaceIntegrator`, since pbrt-v2's default differs from path tracing.
    pub(super) fn check_old_transport(&mut self, whole: &Source) {
        if self.context.version == Version::V2 && !self.once.contains_key("depth") {
            let what = "no SurfaceIntegrator is named: pbrt-v2 would use direct lighting with 5 mirror reflections; \
                        path tracing of that depth is used";
            self.log.notice(whole, what);
        }
    }

    /// Executes `Renderer`, `SurfaceIntegrator` or `VolumeIntegrator`, pbrt-v2's directives in place of `Integrator`.
    pub(super) fn read_old_transport(&mut self, mut d: Directive<'_>) {
        let mut params = self.params(&mut d, "");
        let kind = d.texts[0].as_str();
        let what = format!("{} (of pbrt-v2) is ignored; {}", params.of, transport(kind));
        self.log.ignored_setting(&d.source, what);
        let depth = match d.word {
            "SurfaceIntegrator" => {
                let depth = params.integer("maxdepth", 0, i32::MAX).unwrap_or(5) as u32;
                // pbrt-v2's path tracer also lights the vertex after the last bounce: one event more than others.
                Some(if kind == "path" { depth.saturating_add(1) } else { depth })
            }
            "Renderer" if kind == "metropolis" => Some(params.integer("maxdepth", 0, i32::MAX).unwrap_or(7) as u32),
            _ => None,
        };
        if let Some(depth) = depth {
            self.meet("depth", &d.source);
            self.scene.max_depth = Some(depth);
        }
        params.ignore_rest();
        params.finish(&mut self.log);
    }

    fn read_camera(&mut self, kind: &str, source: Source, mut params: Params) {
        if !matches!(kind, "perspective" | "orthographic") {
            // Another projection would change the whole image, so it is always an error.
            let what =
                format!("Camera {} is not supported; use Camera \"perspective\" or \"orthographic\"", shown(kind));
            self.log.problem(&source, what);
            return;
        }
        let positive = |v: f64| v > 0.0;
        let projection = if kind == "perspective" {
            Projection::Perspective { fov: self.field_of_view(&mut params) }
        } else {
            params.ignore(&["fov"]);
            Projection::Orthographic
        };
        let aspect = params.has("frameaspectratio").then(|| params.float("frameaspectratio", 1.0, positive, "above 0"));
        let lens_radius = params.float("lensradius", 0.0, |v| v >= 0.0, "at least 0");
        let focal_distance = params.float("focaldistance", 1e6, positive, "above 0");
        let window = params.array::<4>("screenwindow", Type::Float);
        if let Some(([x0, x1, y0, y1], line)) = window
            && !(x0 < x1 && y0 < y1)
        {
            params.problem(line, "parameter screenwindow must be x0 x1 y0 y1 with x0 < x1 and y0 < y1");
        }
        let line = params.peek("shutterclose").map_or(source.line, |p| p.line);
        let mut shutter = [("shutteropen", 0.0), ("shutterclose", 1.0)]
            .map(|(name, default)| params.float(name, default, |_| true, "finite"));
        if shutter[0] > shutter[1] {
            params.notice(line, "the shutter closes before it opens; both times are swapped, as in pbrt");
            shutter.swap(0, 1);
        }
        let ctm = self.state.ctm;
        let (to_world, moved) = (ctm.start.inverse(), ctm.end.inverse());
        self.spaces.insert("camera".into(), [to_world, moved]);
        if params.finish(&mut self.log) {
            // The current outside medium surrounds the camera.
            let media = self.state.media.clone();
            let medium = media.and_then(|media| self.medium_named(media.outside.as_deref(), &media.source));
            self.scene.camera = Camera {
                to_world,
                moves_to: ctm.moves_to().map(|_| moved),
                projection,
                aspect,
                screen_window: window.map(|w| w.0),
                lens_radius,
                focal_distance,
                shutter,
                medium,
                source,
            };
        }
    }

    fn field_of_view(&self, params: &mut Params) -> f64 {
        if self.context.version.is_old() && params.has("halffov") {
            return 2.0 * params.float("halffov", 45.0, |v| v > 0.0 && v < 90.0, "between 0 and 90 degrees");
        }
        params.float("fov", 90.0, |v| v > 0.0 && v < 180.0, "between 0 and 180 degrees")
    }

    fn read_film(&mut self, kind: &str, source: &Source, mut params: Params) {
        let usual = if self.context.version.is_old() { "image" } else { "rgb" };
        if kind != usual {
            self.log.notice(source, format!("Film {} is read as Film \"rgb\"", shown(kind)));
        }
        let [width, height] = if self.context.version.is_old() { [640, 480] } else { [1280, 720] };
        let width = params.integer("xresolution", 1, i32::MAX).unwrap_or(width) as u32;
        let height = params.integer("yresolution", 1, i32::MAX).unwrap_or(height) as u32;
        let film = &mut self.scene.film;
        film.resolution = [width, height];
        film.file_name = params.text("filename").map(|t| t.0);
        film.crop = crop(&mut params, [width, height]);
        params.not_followed(&["diagonal", "iso", "whitebalance", "sensor", "exposuretime", "maxcomponentvalue"]);
        params.ignore(&["savefp16"]);
        if self.context.version.is_old() {
            params.not_followed(&["scale", "maxsampleluminance", "display"]);
        }
        params.finish(&mut self.log);
    }

    fn read_sampler(&mut self, mut params: Params) {
        let spp = params.integer("pixelsamples", 1, i32::MAX);
        let strata = [params.integer("xsamples", 1, i32::MAX), params.integer("ysamples", 1, i32::MAX)];
        self.scene.film.spp = match (spp, strata) {
            (Some(spp), _) => Some(spp as u32),
            // pbrt-v4's stratified sampler has 4 x 4 strata by default.
            (None, [Some(x), y]) => (x as u32).checked_mul(y.unwrap_or(4) as u32),
            (None, [None, Some(y)]) => (y as u32).checked_mul(4),
            (None, [None, None]) => None,
        };
        params.ignore(&["seed", "randomization", "jitter", "dimensions"]);
        params.finish(&mut self.log);
    }

    fn read_integrator(&mut self, kind: &str, source: &Source, mut params: Params) {
        if kind != "path" {
            let what = format!("Integrator {} is ignored; {}", shown(kind), transport(kind));
            self.log.ignored_setting(source, what);
        }
        // pbrt-v4's default is 5.
        self.scene.max_depth = Some(params.integer("maxdepth", 0, i32::MAX).unwrap_or(5) as u32);
        params.not_followed(&["regularize", "lightsampler"]);
        if kind != "path" {
            params.ignore_rest();
        }
        params.finish(&mut self.log);
    }

    fn read_filter(&mut self, kind: &str, source: &Source, mut params: Params) {
        let old = self.context.version.is_old();
        let default = match (kind, old) {
            ("box", _) => 0.5,
            ("triangle", _) | ("gaussian", true) => 2.0,
            ("gaussian", false) => 1.5,
            _ => {
                let what = format!("PixelFilter {} (other than box, triangle and gaussian)", shown(kind));
                self.log.unsupported(source, &what);
                return;
            }
        };
        let positive = |v: f64| v > 0.0;
        let names = if old { ["xwidth", "ywidth"] } else { ["xradius", "yradius"] };
        let radius = names.map(|name| params.float(name, default, positive, "above 0"));
        let filter = match kind {
            "box" => PixelFilter::Box { radius },
            "triangle" => PixelFilter::Triangle { radius },
            // exp(-alpha x^2) is a Gaussian of this standard deviation.
            _ if old => {
                let alpha = params.float("alpha", 2.0, positive, "above 0");
                PixelFilter::Gaussian { radius, sigma: (0.5 / alpha).sqrt() }
            }
            _ => PixelFilter::Gaussian { radius, sigma: params.float("sigma", 0.5, positive, "above 0") },
        };
        if params.finish(&mut self.log) {
            self.scene.film.pixel_filter = filter;
        }
    }
}

/// Returns advice on the integrator `kind`: Dapple's default, and the option for a similar integrator if there is one.
fn transport(kind: &str) -> String {
    let (ours, method) = match kind {
        "bdpt" => ("bdpt", "bidirectional path tracing"),
        "mlt" | "metropolis" => ("metropolis", "Metropolis sampling"),
        "sppm" | "photonmap" => ("photons", "photon mapping"),
        "igi" => ("instant", "instant radiosity"),
        "ambientocclusion" => ("ambient-occlusion", "ambient occlusion"),
        _ => return "path tracing is used".into(),
    };
    format!("by default, the scene's effects determine the integrator; for {method}, use --integrator {ours}")
}

/// Returns the crop window in pixels: x0, y0, x1, y1; `None` if the file sets none or an empty one. `cropwindow` takes
/// precedence over `pixelbounds`, as in pbrt.
fn crop(params: &mut Params, resolution: [u32; 2]) -> Option<[u32; 4]> {
    let bounds = params.array::<4>("pixelbounds", Type::Integer);
    let window = params.array::<4>("cropwindow", Type::Float);
    let (crop, line) = match (window, bounds) {
        (Some((w, line)), _) => {
            let pixel = |part: f64, side: usize| (f64::from(resolution[side]) * part.clamp(0.0, 1.0)).ceil() as u32;
            let [x0, x1, y0, y1] = [w[0].min(w[1]), w[0].max(w[1]), w[2].min(w[3]), w[2].max(w[3])];
            ([pixel(x0, 0), pixel(y0, 1), pixel(x1, 0), pixel(y1, 1)], line)
        }
        (None, Some((b, line))) => {
            let pixel = |value: f64, side: usize| value.clamp(0.0, f64::from(resolution[side])) as u32;
            let crop = [pixel(b[0], 0), pixel(b[2], 1), pixel(b[1], 0), pixel(b[3], 1)];
            if b.iter().any(|v| v.fract() != 0.0) {
                params.problem(line, "parameter pixelbounds takes whole numbers; remove the fractions");
            }
            if [b[0], b[2], b[1], b[3]] != crop.map(f64::from) {
                params.notice(line, "pixelbounds reach beyond the image; cut to it");
            }
            (crop, line)
        }
        (None, None) => return None,
    };
    if crop[0] >= crop[2] || crop[1] >= crop[3] {
        params.problem(line, "the crop window holds no pixel; give it as x0 x1 y0 y1 with x0 < x1 and y0 < y1");
        return None;
    }
    Some(crop)
}
