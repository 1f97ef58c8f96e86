//! Tasks run with the machine's vectors: 16 lanes, 8, 4 or 1. Debug builds use 8 lanes or 1 on x86-64.

use pulp::WithSimd;

/// Runs a task with the vectors of this machine.
pub(crate) fn dispatch<T: WithSimd>(task: T) -> T::Output {
    #[cfg(test)]
    match tests::LANES.load(std::sync::atomic::Ordering::Relaxed) {
        1 => return task.with_simd(pulp::Scalar),
        // Emulated vectors take long to compile.
        #[cfg(any(not(debug_assertions), not(target_arch = "x86_64")))]
        4 => return task.with_simd(pulp::Scalar128b),
        // Emulated vectors of eight would be compiled for this test alone.
        #[cfg(target_arch = "x86_64")]
        8 => {
            if let Some(v3) = pulp::x86::V3::try_new() {
                return pulp::Simd::vectorize(v3, task);
            }
        }
        #[cfg(not(target_arch = "x86_64"))]
        8 => return task.with_simd(pulp::Scalar256b),
        _ => {}
    }
    // Debug builds leave out a copy of all loops for 16 lanes, which takes long to compile.
    #[cfg(all(debug_assertions, target_arch = "x86_64"))]
    return match pulp::x86::V3::try_new() {
        Some(v3) => pulp::Simd::vectorize(v3, task),
        None => task.with_simd(pulp::Scalar),
    };
    #[cfg(not(all(debug_assertions, target_arch = "x86_64")))]
    pulp::Arch::new().dispatch(task)
}

#[cfg(test)]
mod tests {
    use crate::ClusterRegression;
    use crate::parameters::NEEDS;
    use dapple_core::{Estimate, Film, Filter, Frame};
    use std::sync::atomic::{AtomicUsize, Ordering};

    /// The number of lanes that [`dispatch`](super::dispatch) uses; 0 for those of the machine. Other tests that run at
    /// the same time get the same bits, or fail as well.
    pub(super) static LANES: AtomicUsize = AtomicUsize::new(0);

    /// Windows of several vectors overlap, so sums over them must not depend on the vectors' width.
    #[test]
    fn images_have_the_same_bits_for_any_number_of_lanes() {
        let [width, height] = [200, 30];
        let mut film = Film::new(Frame::new(width, height).unwrap(), NEEDS);
        let mut state = 1u32;
        for pixel in 0..(width * height) as usize {
            for sample in 0..4 {
                state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                let noise = (state >> 8) as f32 / 16_777_216.0;
                let radiance = if noise < 0.02 { 40.0 } else { 0.2 + noise };
                film.push_estimate(pixel, sample % 2, &Estimate::new([radiance; 3]));
            }
        }
        let image = |lanes| {
            LANES.store(lanes, Ordering::Relaxed);
            let image = ClusterRegression::new().apply(&film).unwrap();
            LANES.store(0, Ordering::Relaxed);
            image.radiance.iter().flatten().map(|v| v.to_bits()).collect::<Vec<_>>()
        };
        let wanted = image(0);
        let emulated = if cfg!(all(debug_assertions, target_arch = "x86_64")) { None } else { Some(4) };
        for lanes in [1, 8].into_iter().chain(emulated) {
            assert!(image(lanes) == wanted, "{lanes} lanes");
        }
    }
}
