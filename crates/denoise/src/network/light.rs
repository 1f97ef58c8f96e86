//! A smooth gain that returns the light of fireflies, which the network removes, to their surroundings.

use super::exposed_film::ExposedFilm;
use crate::cells::{CELL, blurred};
use crate::planes::per_pixel;
use dapple_core::film::luminance;
use dapple_core::parallel;

/// Multiplies colours by a smooth gain, so that their total light equals the total light of the film's samples.
///
/// `S` is a blur; `f` and `c` are the luminance of the film and of the colours. The gain is `g = 1 + S((f - c) / S(c))`. `S` is
/// symmetric and preserves sums, so `c g` and `f` have the same sum.
pub(super) fn keep(exposed: &ExposedFilm<'_>, colours: &mut [[f32; 3]]) {
    let ([width, height], [left, top]) = (exposed.size, exposed.padding());
    let size = exposed.padded().map(|n| n / CELL);
    // The light that the pixels of each cell lack, and the light that they have.
    let sums = per_pixel(size[0] * size[1], |cell| {
        let first = [cell % size[0] * CELL, cell / size[0] * CELL];
        let columns = first[0].max(left)..(first[0] + CELL).min(left + width);
        let rows = first[1].max(top)..(first[1] + CELL).min(top + height);
        let mut sums = [0.0; 2];
        for i in rows.flat_map(|y| columns.clone().map(move |x| (y - top) * width + x - left)) {
            let own = luminance(colours[i].map(f64::from));
            let lost = exposed.light(i).map_or(0.0, |light| light - own);
            sums = [sums[0] + lost, sums[1] + own];
        }
        sums
    });
    let own = blurred(sums.iter().map(|[_, own]| *own).collect(), size);
    let share = sums.iter().zip(own).map(|([lost, _], own)| if own > 0.0 { lost / own } else { 0.0 });
    let more = blurred(share.collect(), size);
    parallel::chunks(colours, width, |y, row| {
        for (x, colour) in row.iter_mut().enumerate() {
            let gain = 1.0 + between(&more, size, [x + left, y + top]);
            *colour = colour.map(|c| (f64::from(c) * gain) as f32);
        }
    });
}

/// The value at a pixel, interpolated between the centres of four cells.
fn between(cells: &[f64], size: [usize; 2], pixel: [usize; 2]) -> f64 {
    let place = [0, 1].map(|k| {
        let place = ((pixel[k] as f64 + 0.5) / CELL as f64 - 0.5).clamp(0.0, (size[k] - 1) as f64);
        let first = (place as usize).min(size[k].saturating_sub(2));
        (first, (first + 1).min(size[k] - 1), place - first as f64)
    });
    let [(x0, x1, u), (y0, y1, v)] = place;
    let row = |y: usize| (1.0 - u) * cells[y * size[0] + x0] + u * cells[y * size[0] + x1];
    (1.0 - v) * row(y0) + v * row(y1)
}
