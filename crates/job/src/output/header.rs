//! The header of an OpenEXR file: settings and results of the render, its camera, and distances along the camera's axis.

use super::layers::{coverage, depth, plane_of_features};
use crate::{BudgetSpec, Job, RenderedImage, pixel_filter};
use dapple_core::{Film, Frame, film::Features, plan::Combine};
use dapple_scene::image::Plane;
use dapple_scene::{Camera, Projection};
use glam::{DMat4, DVec3, DVec4};

/// All settings and results of the render, as pairs of attribute name and text. `cpu` is the processor time in seconds;
/// `None` if unknown.
pub(super) fn attributes(job: &Job, image: &RenderedImage, cpu: Option<f64>) -> Vec<(String, String)> {
    let (spec, scene, film) = (job.spec(), job.scene(), &image.film);
    let (record, frame, limits) = (film.record(), job.frame(), job.limits());
    let [[w, h], [x, y], [cw, ch]] = [frame.resolution(), frame.origin(), frame.size()];
    let budgets: Vec<String> = record.budgets.iter().map(u64::to_string).collect();
    let notices: Vec<String> = scene.notices.iter().map(|n| format!("{}: {}", n.source, n.message)).collect();
    let effects: Vec<&str> = job.world().effects().called().iter().map(|c| c.effect.name()).collect();
    let without: Vec<&str> = job.prepared().loaded.without.iter().map(|e| e.name()).collect();
    let list = [
        ("version", env!("CARGO_PKG_VERSION").to_owned()),
        ("scene", scene.name.clone()),
        ("scene-file", scene.camera.source.file.display().to_string()),
        ("sampler", job.sampler_described().to_owned()),
        ("points", job.points_described().to_owned()),
        ("filter", image.filter.clone()),
        ("integrator", job.integrator().to_owned()),
        ("pixel-filter", pixel_filter(&scene.film.pixel_filter)),
        ("seed", spec.seed.to_string()),
        ("budget", budget(job)),
        ("budgets", budgets.join(",")),
        ("min-spp", limits.min_spp.to_string()),
        ("max-spp", limits.max_spp.to_string()),
        ("resolution", format!("{w}x{h}")),
        ("crop", format!("{x},{y},{},{}", x + cw, y + ch)),
        ("max-depth", scene.max_depth.map_or("unlimited".into(), |d| d.to_string())),
        ("light-selection", spec.selection().name().to_owned()),
        ("effects", effects.join(",")),
        ("without", without.join(",")),
        ("notices", notices.join("\n")),
        ("samples", record.samples.to_string()),
        ("spp", image.spp().to_string()),
        ("rays", image.rays().to_string()),
        ("first-hit-rays", image.first_hit_rays.to_string()),
        ("rejected", record.rejected.to_string()),
        ("predicted-relmse", film.predicted_relmse().map_or("unknown".into(), |e| e.to_string())),
        ("predicted-relmse-filtered", record.filtered_relmse.map_or("unknown".into(), |e| e.to_string())),
        ("bias", bias(job, image)),
        // A checked description can always be encoded.
        ("spec", spec.to_json().unwrap_or_default()),
        ("interrupted", record.interrupted.to_string()),
        ("threads", rayon::current_num_threads().to_string()),
        // Serialising plain numbers cannot fail.
        ("seconds", serde_json::to_string(&image.seconds).unwrap_or_default()),
        ("cpu-seconds", cpu.map_or("unknown".into(), |s| s.to_string())),
    ];
    // A text attribute is never empty, so that every reader shows it.
    let filled = |text: String| if text.is_empty() { "none".to_owned() } else { text };
    list.into_iter().map(|(key, text)| (format!("dapple:{key}"), filled(text))).collect()
}

/// Formats the budget in the unit in which the user set it.
fn budget(job: &Job) -> String {
    match job.spec().budget {
        BudgetSpec::Seconds(seconds) => format!("{seconds} seconds"),
        BudgetSpec::Error(relmse) => {
            let most = job.spec().max_spp.unwrap_or(crate::ERROR_SPP);
            let image = if job.is_error_of_filtered() { "filtered" } else { "unfiltered" };
            format!("relMSE {relmse} of the {image} image, at most {most} spp")
        }
        BudgetSpec::Samples(samples) => format!("{samples} samples"),
        BudgetSpec::Scene => "of the scene".into(),
        BudgetSpec::Spp(spp) => match job.limits().budget {
            dapple_core::limits::Budget::Samples(samples) => format!("{spp} spp, {samples} samples"),
            _ => format!("{spp} spp"),
        },
    }
}

/// A phrase about the bias of the image, from its samples and its filter.
fn bias(job: &Job, image: &RenderedImage) -> String {
    let samples = bias_of_samples(job, &image.film);
    match image.filter.as_str() {
        "none" => samples.to_owned(),
        _ => format!("biased by the filter, less with more samples; before filtering: {samples}"),
    }
}

/// A phrase about the bias of the unfiltered image: samples that determine sample counts bias an image that contains them [Kirk
/// and Arvo 1991].
fn bias_of_samples(job: &Job, film: &Film) -> &'static str {
    let rounds = &film.record().rounds;
    let decided = rounds.split_last().is_some_and(|(_, deciding)| deciding.iter().any(|round| round.kept));
    match film.combine() {
        _ if matches!(job.spec().budget, BudgetSpec::Error(_)) => {
            "biased: the end of the render depends on samples in the image"
        }
        _ if job.is_a_priori() || !decided => "none: sample counts do not depend on samples in the image",
        Combine::Equally => "none: the sample counts of each half depend only on the other half",
        _ => "biased: sample counts depend on samples that are or were in the image",
    }
}

/// The distance of the near plane in the matrix to normalized device coordinates, in the file's units. It scales only the
/// third coordinate.
const NEAR: f64 = 1e-3;
/// The distance written for pixels without a surface, as in Blender, because programs that filter distances fail at infinity.
const BACKGROUND: f32 = 1e10;

/// The camera of an image when the shutter opens.
pub(super) struct View {
    camera: Camera,
    resolution: [u32; 2],
    /// The part of the screen that the image shows: x0, x1, y0, y1, at distance 1 for a perspective camera.
    window: [f64; 4],
}

impl View {
    pub(super) fn new(camera: &Camera, resolution: [u32; 2]) -> Self {
        let aspect = camera.aspect.unwrap_or(f64::from(resolution[0]) / f64::from(resolution[1]));
        let window = camera.screen_window.unwrap_or(match aspect {
            a if a > 1.0 => [-a, a, -1.0, 1.0],
            a => [-1.0, 1.0, -1.0 / a, 1.0 / a],
        });
        let unit = match camera.projection {
            Projection::Perspective { fov } => (0.5 * fov.to_radians()).tan(),
            Projection::Orthographic => 1.0,
        };
        Self { camera: camera.clone(), resolution, window: window.map(|w| w * unit) }
    }

    /// The matrix from world space to camera space: x to the right, y up, z forward.
    fn to_camera(&self) -> DMat4 {
        DMat4::from(self.camera.to_world.inverse())
    }

    /// The matrix from world space to normalized device coordinates: -1 to 1 from the left to the right edge of the
    /// image, and from the bottom to the top edge.
    fn to_device(&self) -> DMat4 {
        let [x0, x1, y0, y1] = self.window;
        let (sx, sy) = (2.0 / (x1 - x0), 2.0 / (y1 - y0));
        let (cx, cy) = (-(x0 + x1) / (x1 - x0), -(y0 + y1) / (y1 - y0));
        let project = match self.camera.projection {
            // x' = sx x + cx z, y' = sy y + cy z, z' = z - near, w' = z.
            Projection::Perspective { .. } => [DVec4::new(cx, cy, 1.0, 1.0), DVec4::new(0.0, 0.0, -NEAR, 0.0)],
            Projection::Orthographic => [DVec4::Z, DVec4::new(cx, cy, 0.0, 1.0)],
        };
        let [x, y] = [DVec4::new(sx, 0.0, 0.0, 0.0), DVec4::new(0.0, sy, 0.0, 0.0)];
        DMat4::from_cols(x, y, project[0], project[1]) * self.to_camera()
    }

    /// Returns `worldToCamera` and `worldToNDC` as OpenEXR stores them: row-major, for row vectors. `None` if one isn't finite.
    pub(super) fn matrices(&self) -> Option<[[f32; 16]; 2]> {
        // The matrices here are for column vectors, so their columns are the rows to store.
        let stored = [self.to_camera(), self.to_device()].map(|m| m.to_cols_array().map(|x| x as f32));
        stored.as_flattened().iter().all(|x| x.is_finite()).then_some(stored)
    }

    /// Returns the channels `A` (alpha) and `Z` (distance along the axis) of an image; empty if its film has no features.
    pub(super) fn channels<'a>(&'a self, film: &'a Film, unit: f64) -> Vec<(&'static str, Plane<'a>)> {
        let along = move |i: usize, features: &Features| self.along_axis(film.frame(), i, depth(features, unit));
        let planes = [plane_of_features(film, |_, features| coverage(features)), plane_of_features(film, along)];
        ["A", "Z"].into_iter().zip(planes.into_iter().flatten()).collect()
    }

    /// Converts `length`, the mean length of the paths to a pixel's surfaces, to a distance along the camera's axis.
    fn along_axis(&self, frame: &Frame, pixel: usize, length: f32) -> f32 {
        if !length.is_finite() {
            return BACKGROUND;
        }
        (f64::from(length) * self.cosine(frame, pixel)) as f32
    }

    /// Returns the cosine between the ray through a pixel's centre and the camera's axis.
    fn cosine(&self, frame: &Frame, pixel: usize) -> f64 {
        let Projection::Perspective { .. } = self.camera.projection else { return 1.0 };
        let [x0, x1, y0, y1] = self.window;
        let ([x, y], [w, h]) = (frame.pixel(pixel), self.resolution.map(f64::from));
        let right = x0 + (x1 - x0) * (f64::from(x) + 0.5) / w;
        let up = y1 - (y1 - y0) * (f64::from(y) + 0.5) / h;
        let axes = self.camera.to_world.matrix3;
        (axes * DVec3::new(right, up, 1.0)).normalize().dot(axes.z_axis.normalize())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DAffine3, DMat3};

    fn view(projection: Projection) -> View {
        let matrix3 = DMat3::from_cols(DVec3::NEG_X, DVec3::Y, DVec3::NEG_Z);
        let to_world = DAffine3 { matrix3, translation: DVec3::new(1.0, 2.0, 10.0) };
        View::new(&Camera { to_world, projection, ..Camera::default() }, [40, 20])
    }

    #[test]
    fn matrices_take_the_corners_of_the_view_to_those_of_the_image() {
        let view = view(Projection::Perspective { fov: 90.0 });
        let [to_camera, to_device] = view.matrices().unwrap();
        // Row vectors: the last row holds the translation.
        assert_eq!(to_camera[12..15], [1.0, -2.0, 10.0]);
        let project = |point: [f64; 3]| {
            let m = DMat4::from_cols_array(&to_device.map(f64::from));
            let p = m * DVec3::from_array(point).extend(1.0);
            (p / p.w).to_array()
        };
        // At distance 4 along -z the image is 16 wide and 8 high; its right is -x.
        let corner = project([1.0 - 8.0, 2.0 + 4.0, 6.0]);
        assert!((corner[0] - 1.0).abs() < 1e-6 && (corner[1] - 1.0).abs() < 1e-6, "{corner:?}");
        let centre = project([1.0, 2.0, -5.0]);
        assert!(centre[0].abs() < 1e-6 && centre[1].abs() < 1e-6 && centre[2] < 1.0, "{centre:?}");
    }

    #[test]
    fn distances_are_along_the_axis() {
        let frame = Frame::new(40, 20).unwrap();
        let wide = view(Projection::Perspective { fov: 90.0 });
        let corner = wide.along_axis(&frame, 0, 6.0);
        let cosine = 1.0 / (1.0f64 + 1.95 * 1.95 + 0.95 * 0.95).sqrt();
        assert!((f64::from(corner) - 6.0 * cosine).abs() < 1e-5, "{corner}");
        assert_eq!(wide.along_axis(&frame, 0, f32::INFINITY), BACKGROUND);
        assert_eq!(view(Projection::Orthographic).along_axis(&frame, 0, 6.0), 6.0);
    }
}
