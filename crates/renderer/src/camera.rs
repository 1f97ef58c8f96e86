//! Cameras, which turn a position on the image into a ray.

use crate::SceneError;
use crate::shading::warp::concentric_disk;
use crate::space::Space;
use dapple_geometry::{Motion, Ray};
use dapple_scene::{Camera, Projection};
use glam::{DAffine3, DMat3, DVec3, Mat3, Vec2, Vec3};

/// A camera prepared to generate rays, in the renderer's space (the scene scaled and moved; see [`Space`]).
#[derive(Clone, Debug)]
pub struct CameraView {
    origin: Vec3,
    /// The right, up and forward vectors of the camera's transform, as columns. They are scaled so that the largest
    /// entry lies in [1, 2).
    axes: Mat3,
    /// Half the width and half the height of the image, in pixels.
    half: Vec2,
    /// The size of a pixel in screen units.
    step: Vec2,
    /// The screen position of the image's centre, in screen units.
    shift: Vec2,
    /// The radius of the lens, in units of `axes`; 0 for a pinhole. `focal_distance` is in the same units.
    lens_radius: f32,
    focal_distance: f32,
    /// True for an orthographic camera, whose rays start on the screen and run forward. `step` and `shift` are then in
    /// units of `axes`.
    orthographic: bool,
    /// The motion of a moving camera, and the factor from its matrix to `axes`; `None` for a camera at rest.
    motion: Option<Box<(Motion, f64)>>,
}

/// A kind of camera, chosen at compile time. A pinhole camera then runs no code for lenses or motion.
pub trait Lens: Sync {
    /// Returns the ray through the image position `place`, in pixels from the image's centre with y downwards. `on_lens` in
    /// `[0, 1)^2` selects the point on the lens.
    fn ray(view: &CameraView, place: Vec2, on_lens: [f32; 2]) -> Ray;

    /// Returns the ray as [`ray`](Self::ray) does, at a time in `[0, 1]` within the motion. Cameras at rest ignore the
    /// time.
    #[inline(always)]
    fn ray_at(view: &CameraView, place: Vec2, on_lens: [f32; 2], _time: f32) -> Ray {
        Self::ray(view, place, on_lens)
    }
}

/// A perspective pinhole camera at rest: all rays start at one point.
#[derive(Clone, Copy, Debug)]
pub struct Pinhole;

/// A perspective camera at rest with a thin lens: rays start on a disk and focus in the focal plane.
#[derive(Clone, Copy, Debug)]
pub struct ThinLens;

/// A camera of any kind: perspective or orthographic, moving or at rest, with or without a lens.
#[derive(Clone, Copy, Debug)]
pub struct General;

/// Returns the columns of a camera's transform divided by a power of two, and that power. Returns `None` if the transform is
/// not finite or not invertible.
fn axes(given: DMat3) -> Option<(DMat3, f64)> {
    let longest = given.to_cols_array().into_iter().fold(0.0, |m: f64, x| m.max(x.abs()));
    if !given.is_finite() || longest == 0.0 {
        return None;
    }
    // The scale is divided out, since squares of a very small or large scale leave the range of f32. Division by a
    // power of two is exact.
    let size = longest.log2().floor().clamp(-1000.0, 1000.0).exp2();
    let axes = given * size.recip();
    // At a smaller determinant, the columns lie in a plane within the precision of f32. All numbers are finite here.
    (axes.determinant().abs() > 1e-20).then_some((axes, size))
}

/// Returns the error for a camera transform that is not finite or not invertible.
fn pose_error(camera: &Camera) -> SceneError {
    let what = "the camera's transform is not finite or not invertible; check its scales and LookAt (eye and target must \
                differ, and up must not be parallel to the view direction)";
    SceneError::new(&camera.source, what)
}

/// Returns the motion of a camera and the factor from its matrix to the view's axes; `None` for a camera at rest.
fn motion(
    camera: &Camera,
    pose: DAffine3,
    space: &Space,
    length: f64,
) -> Result<Option<Box<(Motion, f64)>>, SceneError> {
    let Some(end) = camera.moves_to.filter(|end| *end != camera.to_world) else { return Ok(None) };
    let end = space.apply(end);
    let wrong = |e| SceneError::new(&camera.source, format!("the camera's motion is invalid: {e}"));
    let motion = Motion::between(pose, end).map_err(wrong)?;
    if !end.translation.as_vec3().is_finite() || !(end.matrix3 * length.recip()).as_mat3().is_finite() {
        return Err(pose_error(camera));
    }
    Ok(Some(Box::new((motion, length.recip()))))
}

impl CameraView {
    /// Prepares the camera of a scene for images of `resolution` (width and height in pixels).
    ///
    /// # Errors
    ///
    /// [`SceneError`] if the angle of view, the transform, the lens, the motion or the screen window is invalid.
    pub fn new(camera: &Camera, resolution: [u32; 2], space: &Space) -> Result<Self, SceneError> {
        let wrong = |what: String| SceneError::new(&camera.source, what);
        let pose = space.apply(camera.to_world);
        let axes = axes(camera.to_world.matrix3).filter(|_| pose.translation.as_vec3().is_finite());
        let (axes, size) = axes.ok_or_else(|| pose_error(camera))?;
        // Lens radius and focal distance are lengths in camera space, as in pbrt-v4; the scale was divided out of the
        // axes.
        let length = space.scale() * size;
        // The length of a unit of the screen window: at distance 1 for a perspective camera, at any distance
        // otherwise.
        let (unit, orthographic) = match camera.projection {
            Projection::Perspective { fov } if fov > 0.0 && fov < 180.0 => ((fov.to_radians() * 0.5).tan(), false),
            Projection::Perspective { fov } => {
                let what = "is invalid; use an angle above 0 and below 180";
                return Err(wrong(format!("a field of view of {fov} degrees {what}")));
            }
            Projection::Orthographic => (length, true),
        };
        let [lens_radius, focal_distance] = [camera.lens_radius, camera.focal_distance].map(|l| (l * length) as f32);
        let fits = camera.lens_radius > 0.0 && lens_radius < 1e15 && focal_distance > 0.0 && focal_distance < 1e15;
        if camera.lens_radius != 0.0 && !fits {
            return Err(wrong(format!(
                "a lens of radius {} focused at {} is invalid; use a radius of at least 0 and a finite distance above 0",
                camera.lens_radius, camera.focal_distance
            )));
        }
        let [width, height] = resolution.map(f64::from);
        let aspect = camera.aspect.unwrap_or(width / height);
        let window = camera.screen_window.unwrap_or(match aspect {
            a if a > 1.0 => [-a, a, -1.0, 1.0],
            a => [-1.0, 1.0, -1.0 / a, 1.0 / a],
        });
        let [x0, x1, y0, y1] = window;
        // The squares of larger corners would overflow f32, and directions would be NaN.
        let fits = window.iter().all(|w| w.is_finite() && (w * unit).abs() < 1e15);
        if !(aspect.is_finite() && aspect > 0.0 && fits && x0 < x1 && y0 < y1) {
            return Err(wrong("the screen window or aspect ratio is invalid; use finite, positive sizes".to_owned()));
        }
        let step = Vec2::new(((x1 - x0) / width * unit) as f32, ((y1 - y0) / height * unit) as f32);
        let shift = Vec2::new(((x0 + x1) * 0.5 * unit) as f32, ((y0 + y1) * 0.5 * unit) as f32);
        let half = Vec2::new((width * 0.5) as f32, (height * 0.5) as f32);
        let axes = axes.as_mat3();
        let motion = motion(camera, pose, space, length)?;
        let origin = pose.translation.as_vec3();
        Ok(Self { origin, axes, half, step, shift, lens_radius, focal_distance, orthographic, motion })
    }

    /// Returns the camera with the pose at shutter opening as its resting pose, which [`Self::world_to_clip`] uses. Removes
    /// the motion if the shutter closes at the same time.
    pub(crate) fn while_open(mut self, [opens, closes]: [f32; 2]) -> Self {
        (self.origin, self.axes) = self.pose(opens);
        self.motion = self.motion.filter(|_| opens != closes);
        self
    }

    /// Returns the camera's position and its axes at a time in `[0, 1]` within the motion.
    #[inline]
    fn pose(&self, time: f32) -> (Vec3, Mat3) {
        match &self.motion {
            None => (self.origin, self.axes),
            Some(moving) => {
                let (motion, scale) = &**moving;
                let DAffine3 { matrix3, translation } = motion.at(time);
                (translation.as_vec3(), (matrix3 * *scale).as_mat3())
            }
        }
    }

    /// Returns the position of a point of `pixel`, in pixels from the image's centre. `offset` is the vector from the pixel's
    /// centre to the point, in pixels with y downwards.
    ///
    /// The image's centre is subtracted from the integer pixel coordinate first, so that positions near pixel 65535
    /// keep their precision.
    #[inline]
    pub fn place(&self, pixel: [u32; 2], offset: Vec2) -> Vec2 {
        Vec2::new(pixel[0] as f32 + 0.5 - self.half.x, pixel[1] as f32 + 0.5 - self.half.y) + offset
    }

    /// Returns the smaller of a pixel's width and height, at distance 1 along the view direction.
    #[inline]
    fn pixel_width(&self) -> f32 {
        self.step.min_element()
    }

    /// Returns the width of a pixel's footprint at `distance` along a ray, in units of the renderer's space.
    #[inline]
    pub fn footprint(&self, distance: f32) -> f32 {
        if self.orthographic { self.pixel_width() * self.axes.x_axis.length() } else { distance * self.pixel_width() }
    }

    /// Returns the radius in pixels of the circle of confusion of a point in the renderer's space, at a time in `[0, 1]`.
    /// `None` is a point at infinity.
    ///
    /// The radius is negative between the camera and the focal plane, and 0 without a lens. For an orthographic camera, the
    /// radius of a point at infinity is infinite.
    pub fn circle_of_confusion(&self, point: Option<Vec3>, time: f32) -> f32 {
        if !self.has_lens() {
            return 0.0;
        }
        let depth = point.map_or(f32::INFINITY, |point| {
            let (origin, axes) = self.pose(time);
            (axes.inverse() * (point - origin)).z.max(f32::MIN_POSITIVE)
        });
        let shift = if self.orthographic {
            depth / self.focal_distance - 1.0
        } else {
            self.focal_distance.recip() - depth.recip()
        };
        self.lens_radius * shift / self.pixel_width()
    }

    /// Returns the width and the height of the image in pixels.
    pub(crate) fn resolution(&self) -> Vec2 {
        self.half * 2.0
    }

    /// Returns true if the lens has a radius above 0.
    pub fn has_lens(&self) -> bool {
        self.lens_radius > 0.0
    }

    /// Returns true if the camera's pose changes over time.
    pub fn moves(&self) -> bool {
        self.motion.is_some()
    }

    /// Returns true if the camera is orthographic or moves. Its rays must then be generated by [`General`].
    pub fn is_general(&self) -> bool {
        self.orthographic || self.moves()
    }

    /// Returns the camera ray through a pixel at time 0. `offset` is the vector from the pixel's centre, in pixels with y
    /// downwards. `on_lens` in `[0, 1)^2` selects the point on the lens.
    pub fn ray(&self, pixel: [u32; 2], offset: Vec2, on_lens: [f32; 2]) -> Ray {
        self.ray_at(self.place(pixel, offset), on_lens, 0.0)
    }

    /// Returns the camera ray through a position returned by [`place`](Self::place), at a time in `[0, 1]`. `on_lens` in `[0,
    /// 1)^2` selects the point on the lens.
    pub fn ray_at(&self, place: Vec2, on_lens: [f32; 2], time: f32) -> Ray {
        match (self.is_general(), self.has_lens()) {
            (true, _) => General::ray_at(self, place, on_lens, time),
            (false, true) => ThinLens::ray(self, place, on_lens),
            (false, false) => Pinhole::ray(self, place, on_lens),
        }
    }

    /// Returns the rows of the matrix that transforms points `[x, y, z, 1]` of the renderer's space to the image's clip space.
    ///
    /// Points inside the image have `x / w` and `y / w` in `[-1, 1]`, with y downwards. `z` is the depth, positive in front of
    /// the camera. `w` equals `z` for a perspective camera, and is 1 for an orthographic one. The lens is treated as a pinhole,
    /// and a moving camera is in its pose at shutter opening (time 0 for a view made by [`new`](Self::new)).
    pub fn world_to_clip(&self) -> [[f32; 4]; 4] {
        let to_camera = self.axes.inverse();
        let [x, y, z] = [to_camera.row(0), to_camera.row(1), to_camera.row(2)];
        let row = |r: Vec3| [r.x, r.y, r.z, -r.dot(self.origin)];
        let [wide, high] = [self.step.x * self.half.x, self.step.y * self.half.y];
        if self.orthographic {
            let moved = |[a, b, c, d]: [f32; 4], by: f32| [a, b, c, d - by];
            let (across, down) =
                (moved(row(x / wide), self.shift.x / wide), moved(row(-y / high), -self.shift.y / high));
            return [across, down, row(z), [0.0, 0.0, 0.0, 1.0]];
        }
        let across = row((x - z * self.shift.x) / wide);
        let down = row((z * self.shift.y - y) / high);
        [across, down, row(z), row(z)]
    }

    /// Returns the lens blur as `[a, b]`: seen through the lens point `l` of the unit disk (y upwards), a point at depth `z` in
    /// camera space is shifted by `l (a + b / z)` in the image. `a` and `b` are each `[horizontal, vertical]`, in pixels with
    /// y downwards. Returns `None` without a lens, and for an orthographic camera.
    pub fn defocus(&self) -> Option<[[f32; 2]; 2]> {
        let usable = self.has_lens() && !self.orthographic;
        // A row further down has a smaller y in camera space.
        let radius = Vec2::new(self.lens_radius, -self.lens_radius) / self.step;
        usable.then(|| [(radius / self.focal_distance).to_array(), (-radius).to_array()])
    }

    /// Returns the image position of `point` at a time in `[0, 1]`, and its depth along the view direction in camera space.
    /// The position `(x, y)` is in pixels from the top left corner, as seen through the lens' centre. It is returned as `(x w,
    /// y w, w)`; `w` is 1 for an orthographic camera.
    pub(crate) fn project(&self, time: f32, point: DVec3) -> (DVec3, f64) {
        let (origin, axes) = self.pose(time);
        let inner = axes.as_dmat3().inverse() * (point - origin.as_dvec3());
        (self.homogeneous(inner, if self.orthographic { 1.0 } else { inner.z }), inner.z)
    }

    /// Returns the image position of the point at infinity in `direction`, as [`Self::project`] does. Returns `None` for a
    /// point behind the camera, and for an orthographic camera.
    pub(crate) fn project_direction(&self, time: f32, direction: DVec3) -> Option<DVec3> {
        let inner = self.pose(time).1.as_dmat3().inverse() * direction;
        (inner.z > 0.0 && !self.orthographic).then(|| self.homogeneous(inner, inner.z))
    }

    fn homogeneous(&self, inner: DVec3, w: f64) -> DVec3 {
        let (step, shift, half) = (self.step.as_dvec2(), self.shift.as_dvec2(), self.half.as_dvec2());
        let (x, y) = ((inner.x - shift.x * w) / step.x, (shift.y * w - inner.y) / step.y);
        DVec3::new(x + half.x * w, y + half.y * w, w)
    }

    /// Returns the direction to a position on the image in camera space, with z = 1 forward. For an orthographic
    /// camera, returns the point on the screen instead.
    #[inline]
    fn screen(&self, place: Vec2) -> Vec3 {
        Vec3::new(place.x * self.step.x + self.shift.x, -place.y * self.step.y + self.shift.y, 1.0)
    }
}

impl Lens for Pinhole {
    #[inline]
    fn ray(view: &CameraView, place: Vec2, _: [f32; 2]) -> Ray {
        Ray::new(view.origin, (view.axes * view.screen(place)).normalize())
    }
}

impl Lens for ThinLens {
    #[inline]
    fn ray(view: &CameraView, place: Vec2, on_lens: [f32; 2]) -> Ray {
        let lens = concentric_disk(on_lens) * view.lens_radius;
        let focus = view.screen(place) * view.focal_distance;
        let from = Vec3::new(lens.x, lens.y, 0.0);
        Ray::new(view.origin + view.axes * from, (view.axes * (focus - from)).normalize())
    }
}

impl Lens for General {
    fn ray(view: &CameraView, place: Vec2, on_lens: [f32; 2]) -> Ray {
        Self::ray_at(view, place, on_lens, 0.0)
    }

    fn ray_at(view: &CameraView, place: Vec2, on_lens: [f32; 2], time: f32) -> Ray {
        let (origin, axes) = view.pose(time);
        let screen = view.screen(place);
        // The origin of a pinhole's ray, and the vector along the ray with z = 1.
        let (start, forward) =
            if view.orthographic { (Vec3::new(screen.x, screen.y, 0.0), Vec3::Z) } else { (Vec3::ZERO, screen) };
        if !view.has_lens() {
            return Ray::new(origin + axes * start, (axes * forward).normalize());
        }
        let lens = concentric_disk(on_lens) * view.lens_radius;
        let aside = Vec3::new(lens.x, lens.y, 0.0);
        let direction = forward * view.focal_distance - aside;
        Ray::new(origin + axes * (start + aside), (axes * direction).normalize())
    }
}

/// The camera ray through a point of the scene, found by [`CameraView::connect`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CameraConnection {
    /// The position in the image, in pixels from the top left corner.
    pub place: Vec2,
    /// The start of the camera ray: the eye, a point on the lens, or a point on the screen of an orthographic camera.
    pub position: Vec3,
    /// The unit direction from the camera to the point.
    pub direction: Vec3,
    /// The distance from `position` to the point, in units of the renderer's space.
    pub distance: f32,
}

impl CameraView {
    /// Returns the density of camera rays in the unit `direction`, at `distance` from their origin and a time in `[0, 1]`.
    ///
    /// The density is per unit of area perpendicular to `direction`. The rays pass through a single point of the lens and
    /// through positions that are uniform over the whole image. For a perspective camera, the density is `p / distance^2`,
    /// where `p` is the density per solid angle. Directions that point backwards give 0, directions outside the image do not.
    #[inline]
    pub fn density(&self, direction: Vec3, distance: f32, time: f32) -> f32 {
        let (_, axes) = self.pose(time);
        let across = axes.x_axis.cross(axes.y_axis);
        // The determinant, and the forward component of the direction in camera space times the determinant.
        let (volume, forward) = (across.dot(axes.z_axis), across.dot(direction));
        let image = 4.0 * self.half.x * self.half.y * (self.step.x * self.step.y);
        let forward = forward / volume;
        let density = match self.orthographic {
            // Rays through the same point of the lens are parallel.
            true => (image * volume.abs() * forward).recip(),
            false => (image * volume.abs() * (forward * distance) * (forward * distance) * forward).recip(),
        };
        if forward > 0.0 && density.is_finite() { density } else { 0.0 }
    }

    /// Returns the camera ray through a `point`, at a time in `[0, 1]`. `on_lens` in `[0, 1)^2` selects the point on the
    /// lens.
    ///
    /// The image position may lie outside the image. Returns `None` for points behind the camera, and at the camera itself.
    pub fn connect(&self, point: Vec3, on_lens: [f32; 2], time: f32) -> Option<CameraConnection> {
        let (origin, axes) = self.pose(time);
        let to_camera = axes.inverse();
        let lens = if self.has_lens() { (concentric_disk(on_lens) * self.lens_radius).extend(0.0) } else { Vec3::ZERO };
        // The screen position is where the ray crosses the focal plane.
        let (screen, position) = if self.orthographic {
            let inner = to_camera * (point - origin);
            let focus = if self.has_lens() { 1.0 - inner.z / self.focal_distance } else { 0.0 };
            let screen = inner - lens * focus;
            (screen, origin + axes * Vec3::new(screen.x + lens.x, screen.y + lens.y, 0.0))
        } else {
            let start = origin + axes * lens;
            let inner = to_camera * (point - start);
            let focus = if self.has_lens() { lens / self.focal_distance } else { Vec3::ZERO };
            (Vec3::new(inner.x / inner.z + focus.x, inner.y / inner.z + focus.y, inner.z), start)
        };
        let (x, y) = ((screen.x - self.shift.x) / self.step.x, (self.shift.y - screen.y) / self.step.y);
        let (to, place) = (point - position, Vec2::new(x, y) + self.half);
        let distance = to.length();
        let direction = to / distance;
        let in_front = screen.z > 0.0 && distance > 0.0 && direction.is_finite() && place.is_finite();
        in_front.then_some(CameraConnection { place, position, direction, distance })
    }
}
