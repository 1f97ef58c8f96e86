//! Effects of the camera: depth of field and motion blur.

use super::Found;
use super::visible::Visible;
use crate::Scene;

pub(super) fn find_lens(visible: &Visible<'_>, found: &mut Found) {
    let camera = &visible.scene.camera;
    if camera.lens_radius != 0.0 {
        found.add(|| format!("the lens has radius {}", camera.lens_radius), &camera.source);
    }
}

pub(super) fn find_motion(visible: &Visible<'_>, found: &mut Found) {
    let camera = &visible.scene.camera;
    let [open, close] = camera.shutter;
    let [first, second] = motion_span(visible.scene);
    // Nothing moves before and after the motion. NaN counts as an open shutter.
    if open == close || close <= first || open >= second {
        return;
    }
    let camera = [("the camera", camera.to_world, camera.moves_to, &camera.source)];
    let instances = visible.instances.iter().map(|i| ("an instance", i.to_world, i.moves_to, &i.source));
    let shapes = visible.shapes.iter().map(|s| ("a shape", s.to_world, s.moves_to, &s.source));
    for (what, to_world, moves_to, source) in camera.into_iter().chain(instances).chain(shapes) {
        if moves_to.is_some_and(|to| to != to_world) {
            found.add(|| format!("{what} moves while the shutter is open"), source);
        }
    }
}

/// Returns the times at which motion starts and ends. Equal times mean an end of start + 1.
fn motion_span(scene: &Scene) -> [f64; 2] {
    match scene.motion_times {
        [first, second] if first == second => [first, first + 1.0],
        span => span,
    }
}

/// Opens and closes the shutter at the middle of the exposure.
pub(super) fn stop_motion(scene: &mut Scene) {
    let [open, close] = scene.camera.shutter;
    scene.camera.shutter = [open + (close - open) * 0.5; 2];
}
