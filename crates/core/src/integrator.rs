//! Radiance estimates, first hits and training data of integrators.

mod path_record;

pub use path_record::{CERTAIN_LOBE, PathRecord, RARE_LOBE};

use crate::macros::{forward, setters};
use crate::{Draws, Frame, Needs, PointSet, SampleId, Worker, point_set::streams};
use serde::{Deserialize, Serialize};

/// The cluster label of a camera ray that hits no surface; other rays have the label of the cluster they hit.
pub const BACKGROUND: u32 = u32::MAX;

/// The first surface that a sample hits, as the integrator reports it. Samplers read it. Filters read it if the sample has
/// no [`SurfaceFeatures`].
///
/// Position, normal and depth, the arguments of [`FirstHit::new`], are enough for every filter. Albedo improves images most.
/// The other fields are for clusters and some samplers (`docs/book/src/your-renderer.md` has a table).
///
/// ```
/// use dapple_core::FirstHit;
///
/// // A point on the floor, 2.5 units from the camera.
/// let hit = FirstHit::new([0.1, 0.0, 0.7], [0.0, 1.0, 0.0], 2.5).with_albedo([0.8, 0.5, 0.2]).with_material(3);
/// assert_eq!(hit.shading_normal, [0.0, 1.0, 0.0]);
/// ```
#[non_exhaustive]
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct FirstHit {
    /// The hit's position, in the integrator's own units of length.
    pub position: [f32; 3],
    /// Unit normal of the geometry, on the side the ray came from.
    pub geometric_normal: [f32; 3],
    /// Unit shading normal, on the side the ray came from.
    pub shading_normal: [f32; 3],
    /// Fraction of light that the surface reflects, linear RGB in `[0, 1]`; 1 for emitters, clear glass and mirrors.
    pub albedo: [f32; 3],
    /// Distance along the ray, in the units of `position`.
    pub depth: f32,
    /// Width of a pixel projected onto the surface, in the units of `position`; 0 if unknown.
    pub footprint: f32,
    /// Microfacet roughness in `[0, 1]`: 0 for a mirror, 1 for a diffuse surface.
    pub roughness: f32,
    /// The index of the material, in the integrator's numbering.
    pub material: u32,
    /// The index of the shape (mesh, sphere, …), in the integrator's numbering.
    pub shape: u32,
    /// The index of the triangle within the shape; 0 for spheres and other shapes without triangles.
    pub primitive: u32,
}

impl FirstHit {
    /// A hit on a white diffuse surface: material, shape and primitive 0, and an unknown footprint.
    #[inline]
    pub const fn new(position: [f32; 3], normal: [f32; 3], depth: f32) -> Self {
        Self {
            position,
            geometric_normal: normal,
            shading_normal: normal,
            albedo: [1.0; 3],
            depth,
            footprint: 0.0,
            roughness: 1.0,
            material: 0,
            shape: 0,
            primitive: 0,
        }
    }

    setters! {
        /// Sets a shading normal that differs from the geometric normal.
        with_shading_normal(shading_normal: [f32; 3]);
        /// Sets the albedo, linear RGB in `[0, 1]`.
        with_albedo(albedo: [f32; 3]);
        /// Sets the width of a pixel projected onto the surface, in the units of `position`.
        with_footprint(footprint: f32);
        /// Sets the microfacet roughness, in `[0, 1]`.
        with_roughness(roughness: f32);
        /// Sets the index of the material.
        with_material(material: u32);
        /// Sets the index of the shape.
        with_shape(shape: u32);
        /// Sets the index of the triangle within the shape.
        with_primitive(primitive: u32);
    }

    /// Returns `true` if no number is NaN or infinite. Hits for which this is `false` count as misses.
    pub(crate) fn is_finite(&self) -> bool {
        let Self { position, geometric_normal, shading_normal, albedo, depth, footprint, roughness, .. } = self;
        let vectors = [position, geometric_normal, shading_normal, albedo];
        vectors.into_iter().flatten().chain([depth, footprint, roughness]).all(|v| v.is_finite())
    }
}

/// The features of one sample, for filters: position, normal, albedo and depth of the first non-specular surface, seen
/// directly or through mirrors, glass and smooth coats.
///
/// At glass, each path is reflected or refracted at random. The mean features of a pixel blend the reflected and the
/// refracted surface in the same proportions as the mean radiance.
///
/// ```
/// use dapple_core::SurfaceFeatures;
///
/// // A red wall, seen in a mirror that reflects 80 %. The path is 3 units long.
/// let wall = SurfaceFeatures::new([2.0, 0.0, 1.0], [-1.0, 0.0, 0.0], 3.0).with_albedo([0.8 * 0.5, 0.0, 0.0]);
/// # assert_eq!(wall.depth, 3.0);
/// ```
#[non_exhaustive]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfaceFeatures {
    /// The surface's position, in the integrator's own units of length.
    pub position: [f32; 3],
    /// Unit shading normal, on the side the ray came from.
    pub normal: [f32; 3],
    /// Fraction of light that the surface reflects towards the camera, linear RGB in `[0, 1]`: its albedo times the
    /// throughput of the mirrors and glass in front of it.
    pub albedo: [f32; 3],
    /// Length of the path from the camera to the surface, in the units of `position`.
    pub depth: f32,
    /// True if the path chose a lobe of low probability, such as the reflection of glass seen head-on.
    ///
    /// Such samples are few, and their features would add noise to the pixel's mean. The film leaves them out, unless the
    /// pixel has no features yet.
    pub rare: bool,
}

impl SurfaceFeatures {
    /// The features of a white surface.
    #[inline]
    pub const fn new(position: [f32; 3], normal: [f32; 3], depth: f32) -> Self {
        Self { position, normal, albedo: [1.0; 3], depth, rare: false }
    }

    setters! {
        /// Sets the albedo, linear RGB in `[0, 1]`.
        with_albedo(albedo: [f32; 3]);
        /// Sets whether the path chose a lobe of low probability.
        with_rare(rare: bool);
    }

    /// Returns `true` if no number is NaN or infinite.
    pub(crate) fn is_finite(&self) -> bool {
        let Self { position, normal, albedo, depth, .. } = self;
        [position, normal, albedo].into_iter().flatten().chain([depth]).all(|v| v.is_finite())
    }
}

impl From<&FirstHit> for SurfaceFeatures {
    fn from(hit: &FirstHit) -> Self {
        Self::new(hit.position, hit.shading_normal, hit.depth).with_albedo(hit.albedo)
    }
}

/// The motion of a sample's first hit across the image while the shutter is open, for filters that reproject samples over
/// lens and time.
///
/// Let `w` be the hit's depth along the view direction, and `(x, y)` its projection through the centre of the lens, in
/// pixels from the top left corner of the image. Then `(x w, y w, w)` is linear in time for a constant velocity.
///
/// ```
/// use dapple_core::integrator::Trajectory;
///
/// // A point 4 units away at column 10 and row 20 that moves 3 pixels to the right.
/// let moving = Trajectory { inverse_depth: 0.25, motion: [3.0, 0.0, 0.0] };
/// # assert_eq!(moving.inverse_depth, 0.25);
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Trajectory {
    /// 1 / depth; 0 for the background. Depth is measured along the view direction at the sample's time, in the same unit of
    /// length as the camera's focal distance.
    pub inverse_depth: f32,
    /// The change of `(x w, y w, w)` (see [`Trajectory`]) while the shutter is open, divided by `w` at the sample's time.
    pub motion: [f32; 3],
}

/// An integrator's result for one sample: radiance, first hit, features and cost.
///
/// ```
/// use dapple_core::Estimate;
///
/// let shadowed = Estimate::new([0.0; 3]);
/// assert_eq!((shadowed.first_hit, shadowed.cost), (None, 1));
/// let lit = Estimate::new([0.2, 0.3, 0.5]).with_cost(2);
/// # assert_eq!(lit.cost, 2);
/// ```
#[non_exhaustive]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// The radiance, linear RGB, finite and not negative. The film rejects and counts other values.
    pub radiance: [f32; 3],
    /// The first hit, if [`Draws::wants_first_hit`] requests it and the sample hit a surface. A hit with a NaN or an
    /// infinity counts as a miss.
    pub first_hit: Option<FirstHit>,
    /// The features of the first non-specular surface, if [`Draws::wants_features`] requests them. With `None`, a NaN or an
    /// infinity, the film records the features of `first_hit`.
    pub features: Option<SurfaceFeatures>,
    /// The trajectory of the first hit, if [`Draws::wants_trajectory`] requests it. A trajectory that is `None`, or has a
    /// NaN or an infinity, counts as a static background.
    pub trajectory: Option<Trajectory>,
    /// The part of the radiance that comes from light sources seen directly, through mirrors, or through glass that shows
    /// the source in almost every sample. 0 unless [`Draws::wants_emission`] requests it.
    ///
    /// Filters do not spread bright emission to other pixels. An emission of 0 is always valid.
    pub emission: [f32; 3],
    /// The part of the radiance that was scattered by at least two non-specular surfaces or points in media. 0 unless
    /// [`Draws::wants_indirect`] requests it.
    ///
    /// Filters may process `indirect` and the rest separately, since direct shadows have sharp edges and indirect lighting
    /// has more noise. Filters return the sum of both results, so any value from 0 to `radiance` is valid.
    pub indirect: [f32; 3],
    /// The cost of the sample: the number of rays traced.
    pub cost: u32,
    /// True if [`Estimate::with_first_hit`] was called, with a hit or without one. If no sample of a
    /// [`Session`](crate::Session) reports hits or misses, the session refuses filters that read features.
    pub says_hit: bool,
}

impl Estimate {
    /// An estimate with this radiance and without a first hit; its cost is one ray.
    #[inline]
    pub const fn new(radiance: [f32; 3]) -> Self {
        Self {
            radiance,
            first_hit: None,
            features: None,
            trajectory: None,
            emission: [0.0; 3],
            indirect: [0.0; 3],
            cost: 1,
            says_hit: false,
        }
    }

    /// Returns true if the estimate reports a hit or a miss.
    #[inline]
    pub(crate) const fn reports_hit(&self) -> bool {
        self.says_hit || self.first_hit.is_some() || self.features.is_some() || self.trajectory.is_some()
    }

    /// Sets the first hit: a [`FirstHit`], or an `Option` of one; `None` means that the sample hit no surface.
    #[inline]
    #[must_use]
    pub fn with_first_hit(mut self, hit: impl Into<Option<FirstHit>>) -> Self {
        self.first_hit = hit.into();
        self.says_hit = true;
        self
    }

    /// Sets the features of the surface seen in a mirror or through glass. With `None`, the first hit supplies the features.
    #[inline]
    #[must_use]
    pub fn with_features(mut self, features: impl Into<Option<SurfaceFeatures>>) -> Self {
        self.features = features.into();
        self
    }

    setters! {
        /// Sets the part of the radiance that light sources emit towards the camera.
        with_emission(emission: [f32; 3]);
        /// Sets the indirect part of the radiance.
        with_indirect(indirect: [f32; 3]);
        /// Sets the cost, in rays.
        with_cost(cost: u32);
    }
}

impl From<[f32; 3]> for Estimate {
    /// An estimate with this radiance, without a first hit.
    #[inline]
    fn from(radiance: [f32; 3]) -> Self {
        Self::new(radiance)
    }
}

impl From<([f32; 3], Option<FirstHit>)> for Estimate {
    /// An estimate with this radiance and this first hit.
    #[inline]
    fn from((radiance, hit): ([f32; 3], Option<FirstHit>)) -> Self {
        Self::new(radiance).with_first_hit(hit)
    }
}

/// An integrator: estimates the radiance of a pixel from the random numbers of one sample.
///
/// ```
/// use dapple_core::{Block, Draws, Estimate, Integrator, Worker};
///
/// const PLACE: Block = Block::new(0);
///
/// /// A white disk of 20 pixels' radius around the corner.
/// struct Disk;
///
/// impl Integrator for Disk {
///     fn estimate(&self, draws: &Draws<'_>, _: &mut Worker) -> Estimate {
///         let [column, row] = draws.pixel();
///         let [u, v, ..] = draws.block(PLACE);
///         let distance = (column as f32 + u).hypot(row as f32 + v);
///         Estimate::new(if distance < 20.0 { [1.0; 3] } else { [0.0; 3] })
///     }
/// }
/// ```
pub trait Integrator: Sync {
    /// Estimates the radiance of pixel `draws.pixel()` from one sample. Must be a pure function of the random numbers and
    /// of what [`Integrator::learn`] has learned so far.
    fn estimate(&self, draws: &Draws<'_>, log: &mut Worker) -> Estimate;

    /// Returns the first hit and the features of one sample without its radiance, and their cost in rays. `None`, the
    /// default, means that they cost as much as a whole sample. Must be a pure function of the random numbers.
    ///
    /// At few samples per pixel, features are noisy at edges. [`Render`](crate::Render) therefore requests 4 such
    /// feature-only samples before a pixel's first sample, and up to 12 where they vary. Filters then follow edges better.
    /// With a time limit, this happens before the second round, if that round has at least 4 samples per pixel.
    ///
    /// If [`Draws::wants_emission`] returns `true`, the estimate may include emission, with the same expected value as in
    /// [`Integrator::estimate`]. Where emission varies, as at the edge of a light source, 64 more feature-only samples are
    /// taken. Filters average their emission with that of ordinary samples. An emission of 0 in all of them changes nothing.
    fn features_alone(&self, draws: &Draws<'_>) -> Option<Estimate> {
        let _ = draws;
        None
    }

    /// The statistics that the film must record for this integrator: [splats](Needs::with_splats), for example.
    /// [`Render`] requests them; the host of a [`Session`](crate::Session) must request them itself.
    ///
    /// [`Render`]: crate::Render
    fn needs(&self) -> Needs {
        Needs::none()
    }

    /// Returns `true` if this integrator writes to [`Worker`] and expects [`Integrator::learn`]. Called before
    /// each training pass: an integrator that has learned enough returns `false` to skip the pass.
    fn wants_training(&self) -> bool {
        false
    }

    /// Learns from the values noted in one training pass ([`Worker::note`]), between two passes. Notes are merged
    /// in a fixed order, so the result does not depend on threads.
    ///
    /// The first pass traces one sample per pixel. Each later pass traces as many as all earlier passes together, but at
    /// most the rest of the round: 1, 1, 2, 4, …
    ///
    /// The learned state must depend on the training passes only. A render resumed from a [`Snapshot`](crate::Snapshot)
    /// replays the recorded passes in order, so the learned state is not saved.
    fn learn(&mut self, pass: &TrainingData) {
        let _ = pass;
    }

    /// The maximum number of bytes that learning takes in a render of `pixels` pixels, including the training data that the
    /// render keeps. The default is 0.
    fn training_memory(&self, pixels: u64) -> u64 {
        let _ = pixels;
        0
    }

    /// The times at which this integrator prepares itself for samples, [`Prepares::Never`] by default. Called before
    /// each pass.
    fn prepares(&self) -> Prepares {
        Prepares::Never
    }

    /// Prepares for a pass before its samples are traced: traces paths from the light sources, for example, and stores them
    /// for [`Integrator::estimate`].
    ///
    /// The stored state must depend only on `pass` and on the training passes so far, with sums in a fixed order. A resumed
    /// render prepares for its current pass again, so nothing is saved.
    fn prepare(&mut self, pass: &Pass<'_>) -> PreparationCost {
        let _ = pass;
        PreparationCost::default()
    }

    /// The estimated bytes of the state that [`Integrator::prepare`] stores for an image, 0 by default. Called before
    /// preparation.
    fn memory(&self, frame: &Frame) -> u64 {
        let _ = frame;
        0
    }
}

forward!(Integrator for &mut T, Box<T>; {
    ref estimate(draws: &Draws<'_>, log: &mut Worker) -> Estimate;
    ref features_alone(draws: &Draws<'_>) -> Option<Estimate>;
    ref needs() -> Needs;
    ref wants_training() -> bool;
    ref training_memory(pixels: u64) -> u64;
    ref prepares() -> Prepares;
    ref memory(frame: &Frame) -> u64;
    mut learn(pass: &TrainingData);
    mut prepare(pass: &Pass<'_>) -> PreparationCost;
});

/// The sums of all values that an integrator [noted](Worker::note) under one key in one training pass.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrainingSum {
    /// The key that the integrator chose.
    pub key: u64,
    /// The number of values noted.
    pub count: u64,
    /// The sum of the values.
    pub sum: f64,
    /// The sum of the squared values.
    pub sum_of_squares: f64,
}

impl TrainingSum {
    pub(crate) fn add(&mut self, other: &TrainingSum) {
        self.count += other.count;
        self.sum += other.sum;
        self.sum_of_squares += other.sum_of_squares;
    }
}

/// The sums of all values that integrators noted in a training pass, sorted by key.
///
/// Values are summed in squares of 16x16 pixels first, then in rows of squares, then over all rows of squares in order. The
/// sums are bit-identical for any number of threads.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct TrainingData {
    pub(crate) entries: Vec<TrainingSum>,
}

impl TrainingData {
    /// Merges the sums of an image's parts, given in the order of the image, by sorting them by key. This is several times
    /// faster than a tree.
    pub(crate) fn merge(parts: &[Vec<TrainingSum>]) -> Self {
        let mut entries = parts.concat();
        // Equal keys stay in order.
        entries.sort_by_key(|e| e.key);
        entries.dedup_by(|next, kept| {
            let same = next.key == kept.key;
            if same {
                kept.add(next);
            }
            same
        });
        // Kept for the whole render; merging mostly shortens the list.
        entries.shrink_to_fit();
        Self { entries }
    }

    /// The sums per key, in ascending order of key.
    pub fn entries(&self) -> &[TrainingSum] {
        &self.entries
    }
}

/// The times at which an integrator prepares itself ([`Integrator::prepare`]).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum Prepares {
    /// Never.
    #[default]
    Never,
    /// Once, before the first sample.
    Once,
    /// Before each pass of about two samples per pixel: one for each half of the film.
    ///
    /// If few pixels get samples in a round, its passes have more samples per pixel, so that all passes take about the same
    /// time. Their lengths depend on the plans only.
    EveryPass,
}

/// A pass of samples for which an integrator prepares: the argument of [`Integrator::prepare`].
#[non_exhaustive]
pub struct Pass<'a> {
    /// The number of the pass, from 0.
    pub number: u32,
    /// The point set of the render.
    pub points: &'a dyn PointSet,
    /// The frame of the image.
    pub frame: Frame,
}

impl<'a> Pass<'a> {
    /// The random numbers of light path `path` in this pass, a pure function of point set, pass and path.
    ///
    /// The paths of a pass are samples of one pixel in the stream [`streams::LIGHT`], so that they are well distributed
    /// together.
    pub fn draws(&self, path: u64) -> Draws<'a> {
        let capacity = self.points.capacity().max(1);
        let pixel = [self.number, u32::try_from(path / capacity).unwrap_or(u32::MAX)];
        Draws::new(self.points, SampleId::new(pixel, streams::LIGHT, path % capacity))
    }
}

/// The cost of one preparation.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PreparationCost {
    /// The number of rays traced.
    pub rays: u64,
}
