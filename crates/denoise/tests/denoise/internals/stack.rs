//! Copies of a tile's planes.

use super::*;
use crate::planes::Plane;

#[test]
fn moved_rows_hold_the_moved_pixels() {
    let size = [150, 40];
    let plane: Plane = (0..6000).map(|i| i as f32).collect();
    let mut tile = Stack::default();
    tile.copy([&plane, &plane], size, [0, 0]);
    tile.copy([&plane, &plane], size, [64, 16]);
    for (y, parity, dx, dy) in [(0, 0, 0, 0), (3, 1, -7, 7), (15, 0, -7, -7), (8, 1, 7, 0), (8, 0, 6, 1)] {
        let row = tile.moved(y, parity, [dx, dy]);
        assert_eq!(row.len(), COLUMNS + LANES);
        for (i, value) in row[COLUMNS..].iter().enumerate() {
            let x = (64 + 2 * i as isize + parity as isize + dx).clamp(0, 149);
            let y = (16 + y as isize + dy).clamp(0, 39);
            assert_eq!(*value, (y * 150 + x) as f32);
        }
    }
}

#[test]
fn planes_are_cleared_beyond_the_frame_only() {
    for (width, height, origin) in [(150, 40, [0, 0]), (150, 40, [128, 32]), (3, 1, [0, 0]), (65, 17, [64, 16])] {
        let plane = vec![1.0; width * height];
        let mut tile = Stack::default();
        tile.copy([&plane, &plane], [width, height], origin);
        tile.clear_outside(1, [width, height], origin);
        for (at, value) in tile.0.iter().enumerate() {
            let (row, within) = (at / (4 * COLUMNS), at % (4 * COLUMNS));
            let (parity, k, column) = (within / (2 * COLUMNS), within / COLUMNS % 2, within % COLUMNS);
            if 2 * column + parity >= WIDTH + 2 * MARGIN {
                continue;
            }
            let inside = (MARGIN..MARGIN + width).contains(&(origin[0] + 2 * column + parity))
                && (MARGIN..MARGIN + height).contains(&(origin[1] + row));
            assert_eq!(*value, f32::from(u8::from(inside || k == 0)), "row {row}, column {column}, {parity}, {k}");
        }
    }
}
