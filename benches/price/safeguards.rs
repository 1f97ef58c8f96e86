//! The safeguards: the time of each, and the inputs that fail without it.

use super::{Break, Image, Ratio, Result, Row, SPP, in_turn, of_whole, pairs, scene, seconds};
use dapple_core::film::{RejectedReason, RgbMoments};
use dapple_core::render::{Control, Monitor, NoMonitor, Status};
use dapple_core::samplers::Uniform;
use dapple_core::{Block, Draws, Estimate, Film, Frame, Integrator, Limits, Needs, Render, SampleId, Snapshot, Worker};
use dapple_geometry::{Disk, Geometry, Mesh, Ray, Shape, Sphere};
use dapple_job::checkpoint::{Identity, StateFile, StateKind, Store};
use dapple_low_discrepancy::Sobol;
use dapple_renderer::{Space, World, integrator};
use dapple_scene::{Geometry as Described, Scene};
use glam::{DAffine3, DVec3, Vec2, Vec3};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::hint::black_box;
use std::time::Instant;

/// Recentring: scenes are moved to the origin and scaled in f64, before conversion to f32.
pub(crate) fn recentring(count: usize) -> Result<Row> {
    // Half a million corners.
    const LOADED: &str = "terrain";
    let loaded = scene(LOADED)?;
    let corners = |to_f32: &dyn Fn(DVec3) -> Vec3| -> Vec<Vec3> {
        let mut all = Vec::new();
        for shape in &loaded.shapes {
            if let Described::Mesh(mesh) = &shape.geometry {
                all.extend(mesh.positions.iter().map(|p| to_f32(shape.to_world.transform_point3(*p))));
            }
        }
        all
    };
    let recentred = || {
        let space = Space::of(&loaded);
        corners(&|p| space.point(p).as_vec3())
    };
    let price = pairs(count, |number| {
        let [with, without] = in_turn(number, || Ok(seconds(recentred)), || Ok(seconds(|| corners(&|p| p.as_vec3()))))?;
        let whole = seconds(|| World::with_resolution(&loaded, [16; 2]).map(|world| world.geometry().triangle_count()));
        Ok(of_whole(whole, with - without))
    })?;
    Ok(Row {
        safeguard: "recentring",
        does: "scenes are moved to the origin and scaled by a power of two in f64, before they become f32",
        price,
        price_of: format!("making {LOADED} ready for rays, once; no ray is slower"),
        breaks: vec![scenes_far_away()?],
    })
}

/// The smallest power of ten as distance from the origin at which more than 1 % of primary rays hit another triangle.
fn scenes_far_away() -> Result<Break> {
    const MOVED: &str = "teapot";
    let scene = scene(MOVED)?;
    let (near, raw) = views(&scene)?;
    let [low, high] = near.world.geometry().bounds().unwrap_or([Vec3::ZERO; 2]);
    let width = f64::from((high - low).max_element()) / near.world.space().scale();
    let mut found = Err("nothing breaks".into());
    for power in 3..=8 {
        let by = DAffine3::from_translation(DVec3::new(1.0, -0.6, 0.8) * 10.0_f64.powi(power));
        let mut scene = scene.clone();
        scene.shapes.iter_mut().for_each(|shape| shape.to_world = by * shape.to_world);
        scene.camera.to_world = by * scene.camera.to_world;
        let (far, far_raw) = views(&scene)?;
        let differ = |a: &[Hit], b: &[Hit]| a.iter().zip(b).filter(|(a, b)| a != b).count() as u64;
        let of = raw.len() as u64;
        let [without, with] = [differ(&raw, &far_raw), differ(&near.seen, &far.seen)];
        let input =
            format!("{MOVED} ({width:.0} wide), 10^{power} from the origin: primary rays that see another triangle");
        let seen = "walls crumble and holes open in scenes with the coordinates of maps";
        found = Ok(Break { input, seen, of, without, with });
        if without * 100 > of {
            break;
        }
    }
    found
}

/// The shape and primitive that a ray hits.
type Hit = Option<(u32, u32)>;

/// The hits of the camera's rays in a world.
struct View {
    world: World,
    seen: Vec<Hit>,
}

/// The hits in the renderer's space, and the hits in the file's space, where a renderer without recentring works.
fn views(scene: &Scene) -> Result<(View, Vec<Hit>)> {
    const SIDE: u32 = 64;
    let world = World::with_resolution(scene, [SIDE; 2])?;
    let pixels = (0..SIDE).flat_map(|y| (0..SIDE).map(move |x| [x, y]));
    let rays: Vec<Ray> = pixels.map(|pixel| world.camera().ray(pixel, Vec2::ZERO, [0.5; 2])).collect();
    let seen = |geometry: &Geometry, rays: &[Ray]| -> Vec<Hit> {
        rays.iter().map(|ray| geometry.closest(ray).map(|hit| (hit.shape, hit.primitive))).collect()
    };
    let origin = |ray: &Ray| DVec3::from_array(world.space().world(ray.origin.to_array())).as_vec3();
    let in_the_file: Vec<Ray> = rays.iter().map(|ray| Ray::new(origin(ray), ray.direction)).collect();
    let mut shapes = Vec::with_capacity(scene.shapes.len());
    for shape in &scene.shapes {
        let to_world = shape.to_world;
        shapes.push(match &shape.geometry {
            Described::Mesh(mesh) => {
                let corners = mesh.positions.iter().map(|p| to_world.transform_point3(*p).as_vec3().to_array());
                Shape::from(Mesh::new(corners.collect(), mesh.triangles.clone())?)
            }
            Described::Sphere { radius } => Shape::from(Sphere::transformed(to_world, *radius)?),
            Described::Disk { height, radius, inner_radius } => {
                Shape::from(Disk::transformed(to_world, *height, *radius, *inner_radius)?)
            }
        });
    }
    let raw = seen(&Geometry::build(shapes)?, &in_the_file);
    let seen = seen(world.geometry(), &rays);
    Ok((View { world, seen }, raw))
}

/// A pixel with sums and sums of squares in f32, as in many small renderers.
#[derive(Clone, Copy, Default)]
struct Sums {
    count: u32,
    sum: [f32; 3],
    squares: [f32; 3],
}

impl Sums {
    #[inline]
    fn push(&mut self, value: [f32; 3]) {
        self.count += 1;
        for (c, x) in value.into_iter().enumerate() {
            self.sum[c] += x;
            self.squares[c] += x * x;
        }
    }

    fn mean(&self) -> f64 {
        f64::from(self.sum[0] / self.count as f32)
    }

    fn variance(&self) -> f64 {
        let n = self.count as f32;
        f64::from((self.squares[0] - self.sum[0] * self.sum[0] / n) / (n - 1.0))
    }
}

/// Adds the samples to pixels of [`SPP`] samples each.
#[inline]
fn sum_up<P: Clone + Default>(samples: &[[f32; 3]], mut push: impl FnMut(&mut P, [f32; 3])) {
    let mut pixels = vec![P::default(); samples.len() / SPP];
    for (pixel, samples) in pixels.iter_mut().zip(samples.chunks(SPP)) {
        samples.iter().for_each(|sample| push(pixel, *sample));
    }
    black_box(pixels);
}

/// Film: statistics in f64 by Welford's method, compared with sums in f32.
pub(crate) fn precise_sums(count: usize, runs: usize, image: &Image) -> Result<Row> {
    let with = |samples: &[[f32; 3]]| sum_up(samples, RgbMoments::push);
    let without = |samples: &[[f32; 3]]| sum_up(samples, Sums::push);
    let (price, part) = image.of_render(count, runs, [&with, &without])?;
    Ok(Row {
        safeguard: "film",
        does: "means and variances are kept in f64, by Welford's steps",
        price,
        price_of: format!("{}: {part:.1} ns a sample more than f32 sums of values and squares", image.describe()),
        breaks: vec![variances(), means()],
    })
}

/// Counts bright, smooth pixels whose variance is wrong by more than a factor of two.
fn variances() -> Break {
    const PIXELS: u64 = 1000;
    let mut rng = Pcg64Mcg::seed_from_u64(6);
    let [mut without, mut with] = [0; 2];
    for _ in 0..PIXELS {
        let samples: [f32; SPP] = std::array::from_fn(|_| rng.random_range(999.9..1000.1));
        let mean = samples.iter().map(|x| f64::from(*x)).sum::<f64>() / SPP as f64;
        let exact = samples.iter().map(|x| (f64::from(*x) - mean).powi(2)).sum::<f64>() / (SPP - 1) as f64;
        let wrong = |variance: f64| u64::from(!(0.5 * exact..=2.0 * exact).contains(&variance));
        let (mut sums, mut moments) = (Sums::default(), RgbMoments::default());
        for x in samples {
            sums.push([x; 3]);
            moments.push([x; 3]);
        }
        without += wrong(sums.variance());
        with += wrong(moments.variance().map_or(f64::NAN, |v| v[0]));
    }
    let input = format!("pixels of radiance 1000 +- .1, {SPP} spp: their variance off by more than a factor of 2");
    let seen = "samples go where nothing is noisy, or stop where something is; error estimates are negative";
    Break { input, seen, of: PIXELS, without, with }
}

/// Counts pixels of one colour whose mean is wrong after many samples.
fn means() -> Break {
    const PIXELS: u32 = 16;
    let [mut without, mut with] = [0; 2];
    for pixel in 1..=PIXELS {
        let radiance = 0.1 * pixel as f32;
        let wrong = |mean: f64| u64::from((mean / f64::from(radiance) - 1.0).abs() > 1e-3);
        let (mut sums, mut moments) = (Sums::default(), RgbMoments::default());
        for _ in 0..1 << 20 {
            let sample = black_box([radiance; 3]);
            sums.push(sample);
            moments.push(sample);
        }
        without += wrong(sums.mean());
        with += wrong(moments.mean[0]);
    }
    let input = "pixels of one colour, .1 to 1.6, 2^20 spp: more than .1 % off".to_owned();
    let seen = "references and merged shards drift by up to a percent, each colour by another";
    Break { input, seen, of: PIXELS.into(), without, with }
}

/// Invalid samples: the test that each sample is a valid radiance.
pub(crate) fn invalid_samples(count: usize, runs: usize, image: &Image) -> Result<Row> {
    let with = |samples: &[[f32; 3]]| {
        let mut rejected = 0_u64;
        sum_up(samples, |pixel: &mut RgbMoments, sample| {
            let is_invalid = RejectedReason::of(sample).is_some();
            rejected += u64::from(is_invalid);
            pixel.push(if is_invalid { [0.0; 3] } else { sample });
        });
        black_box(rejected);
    };
    let without = |samples: &[[f32; 3]]| sum_up(samples, RgbMoments::push);
    let (price, part) = image.of_render(count, runs, [&with, &without])?;
    Ok(Row {
        safeguard: "invalid",
        does: "samples that are NaN, infinite or negative are rejected, counted and listed",
        price,
        price_of: format!("{}: {part:.1} ns a sample", image.describe()),
        breaks: vec![holes()?],
    })
}

/// A grey image in which three samples are invalid.
struct Faulty;

impl Faulty {
    const SIDE: u32 = 64;

    fn radiance(pixel: [u32; 2], index: u64) -> [f32; 3] {
        match (pixel, index) {
            ([9, 20], 3) => [f32::NAN, 1.0, 1.0],
            ([31, 31], 0) => [1.0, f32::INFINITY, 1.0],
            ([50, 7], 15) => [1.0, 1.0, -1e6],
            _ => [1.0; 3],
        }
    }
}

impl Integrator for Faulty {
    fn estimate(&self, draws: &Draws<'_>, _: &mut Worker) -> Estimate {
        let SampleId { pixel, index, .. } = draws.id();
        Estimate::new(Self::radiance(pixel, index))
    }
}

/// Counts the invalid pixels that three invalid samples cause in an image smoothed over 5x5 pixels.
fn holes() -> Result<Break> {
    let side = Faulty::SIDE as usize;
    let frame = Frame::new(Faulty::SIDE, Faulty::SIDE)?;
    let limits = Limits::samples((side * side * SPP) as u64);
    let film = Render::new(frame, &limits).run(&mut Faulty, &mut Image::sampler())?;
    let mean = |i: usize| {
        let mut moments = RgbMoments::default();
        (0..SPP as u64).for_each(|index| moments.push(Faulty::radiance(frame.pixel(i), index)));
        moments.mean
    };
    let around = |i: usize| i.saturating_sub(2)..(i + 3).min(side);
    let wrong = |image: &dyn Fn(usize) -> [f64; 3]| {
        let is_wrong = |i: &usize| {
            let window = around(i / side).flat_map(|y| around(i % side).map(move |x| y * side + x));
            let sum = window.fold([0.0; 3], |sum, j| [0, 1, 2].map(|c| sum[c] + image(j)[c]));
            sum.iter().any(|s| !(s.is_finite() && *s >= 0.0))
        };
        (0..side * side).filter(is_wrong).count() as u64
    };
    let input = format!(
        "three bad samples (NaN, infinite, -1e6) of {}, smoothed over 5x5 pixels: pixels that are no radiance",
        side * side * SPP
    );
    let seen = "black or white squares in the image; its exposure, error and denoiser see nothing else";
    Ok(Break { input, seen, of: (side * side) as u64, without: wrong(&mean), with: wrong(&|i| film.mean(i)) })
}

/// Independent halves, which are needed for reliable error estimates with low-discrepancy samples.
pub(crate) fn halves(count: usize, image: &Image) -> Result<Row> {
    let price = pairs(count, |number| {
        let [with, without] =
            in_turn(number, || image.seconds(Needs::none().with_halves()), || image.seconds(Needs::none()))?;
        Ok(with / without)
    })?;
    Ok(Row {
        safeguard: "halves",
        does: "errors are predicted from two independently scrambled halves, on request",
        price,
        price_of: format!("{}; besides, two short sequences are less even than a long one", image.describe()),
        breaks: vec![predictions()?],
    })
}

/// Pixels with the integrand `4 u v` times a level, which is the pixel's mean. The level grows from one corner of the image to
/// the opposite one.
struct Smooth;

impl Smooth {
    const SIDE: u32 = 32;

    fn level([x, y]: [u32; 2]) -> f64 {
        0.2 + f64::from(x + y) / f64::from(2 * Self::SIDE)
    }
}

impl Integrator for Smooth {
    fn estimate(&self, draws: &Draws<'_>, _: &mut Worker) -> Estimate {
        let [u, v, ..] = draws.block(Block::new(0));
        Estimate::new([Self::level(draws.pixel()) as f32 * 4.0 * u * v; 3])
    }
}

/// Counts images whose predicted relMSE is wrong by more than a factor of 2, for predictions from halves and from the samples'
/// variance.
fn predictions() -> Result<Break> {
    const IMAGES: u64 = 16;
    let side = Smooth::SIDE;
    let frame = Frame::new(side, side)?;
    let limits = Limits::samples((SPP * frame.pixels()) as u64);
    let mean = |of: &dyn Fn(usize) -> f64| (0..frame.pixels()).map(of).sum::<f64>() / frame.pixels() as f64;
    let is_off = |predicted: f64, film: &Film| {
        let relative = |i, level: f64| (film.mean(i)[0] - level).powi(2) / (level * level + 0.01);
        let true_error = mean(&|i| relative(i, Smooth::level(frame.pixel(i))));
        u64::from(!(0.5 * true_error..=2.0 * true_error).contains(&predicted))
    };
    let [mut without, mut with] = [0; 2];
    for seed in 0..IMAGES {
        let film =
            |needs| Render::new(frame, &limits).needs(needs).run(&mut Smooth, &mut Uniform::new(Sobol::new(seed)));
        let halves = film(Needs::none().with_halves())?;
        with += is_off(halves.predicted_relmse().unwrap_or(f64::NAN), &halves);
        let whole = film(Needs::none().with_variance())?;
        // The prediction for independent samples: variance over count.
        let of_pixel = |i: usize| {
            let (moments, mean) = (whole.moments(i), whole.mean(i)[0]);
            moments.variance().map_or(f64::NAN, |v| v[0]) / moments.count as f64 / (mean * mean + 0.01)
        };
        without += is_off(mean(&of_pixel), &whole);
    }
    let input = format!(
        "smooth images of {side}x{side} pixels, {SPP} spp of sobol: predicted relMSE off by more than a factor of 2"
    );
    let seen = "--error renders many times as long as it must, and error maps show where the image is bright";
    Ok(Break { input, seen, of: IMAGES, without, with })
}

/// Checkpoints: a killed render resumes from its last checkpoint.
pub(crate) fn checkpoints(count: usize, image: &Image) -> Result<Row> {
    /// Default seconds between checkpoints of `dapple render`.
    const EVERY: f64 = 60.0;
    let folder = tempfile::tempdir()?;
    let store = Store::lock(&folder.path().join("render.checkpoint"))?;
    let (mut ratios, mut lengths) = (Vec::new(), Vec::new());
    let price = pairs(count, |number| {
        let mut middle = Middle::new(&store, false);
        let with = || {
            let start = Instant::now();
            let _ = middle.render(image)?;
            Ok(start.elapsed().as_secs_f64())
        };
        let [with, without] = in_turn(number, with, || image.seconds(Needs::none()))?;
        ratios.push(with / without);
        lengths.push(without);
        Ok(1.0 + middle.seconds / EVERY)
    })?;
    let [ratio, length] = [ratios, lengths].map(|all| Ratio::of(all).median);
    let each = (price.median - 1.0) * EVERY * 1e3;
    Ok(Row {
        safeguard: "checkpoints",
        does: "the render is saved once a minute, in a file that is whole at any moment",
        price,
        price_of: format!(
            "one checkpoint a minute, {each:.1} ms each where nothing goes on meanwhile; with one in a render of {length:.2} s it \
             is {ratio:.3} of {}",
            image.describe()
        ),
        breaks: vec![killed(image, &store)?],
    })
}

/// A monitor that writes a checkpoint after the first slice, and can stop there.
struct Middle<'a> {
    store: &'a Store,
    stop: bool,
    /// Seconds spent on the checkpoint; 0 before the checkpoint.
    seconds: f64,
    saved: std::result::Result<(), dapple_job::checkpoint::Error>,
}

impl<'a> Middle<'a> {
    fn new(store: &'a Store, stop: bool) -> Self {
        Self { store, stop, seconds: 0.0, saved: Ok(()) }
    }

    fn render(&mut self, image: &Image) -> Result<Film> {
        let film = image.render(Needs::none(), self)?;
        std::mem::replace(&mut self.saved, Ok(()))?;
        Ok(film)
    }
}

impl Monitor for Middle<'_> {
    fn progress(&mut self, status: &Status<'_>) -> Control {
        if self.seconds == 0.0 {
            self.seconds = seconds(|| {
                let identity = Identity::new([("scene", Image::NAME)]);
                self.saved = self.store.save(&StateFile::new(StateKind::Checkpoint, identity, status.snapshot()));
            });
        }
        if self.stop { Control::Stop } else { Control::Continue }
    }
}

/// Stops a render halfway and resumes it. Counts the samples that are traced again plus the pixels that differ.
fn killed(image: &Image, store: &Store) -> Result<Break> {
    let stopped = Middle::new(store, true).render(image)?.record().samples;
    let whole = image.render(Needs::none(), &mut NoMonitor)?;
    let found = Store::read(store.path(), StateKind::Checkpoint)?;
    let snapshot = Snapshot::from_bytes(found.contents.bytes())?;
    let saved = snapshot.film().record().samples;
    let limits = image.limits();
    let render = Render::new(image.frame, &limits);
    let resumed = render.resume(snapshot, &mut *integrator(&image.world), &mut Image::sampler())?;
    let bits = |film: &Film, i| film.mean(i).map(f64::to_bits);
    let other = (0..image.frame.pixels()).filter(|&i| bits(&resumed, i) != bits(&whole, i)).count() as u64;
    let again = (resumed.record().samples - saved).saturating_sub(image.samples() - stopped);
    let input = format!(
        "{} killed half-way, just after a checkpoint: samples to trace again for the same bits",
        image.describe()
    );
    let seen = "the night's work is gone; with checkpoints, at most its last minute";
    Ok(Break { input, seen, of: image.samples(), without: stopped, with: again + other })
}
