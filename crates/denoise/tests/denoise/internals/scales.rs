//! The number of coarse scales.

use super::*;

#[test]
fn scales_grow_with_the_image() {
    let sizes = [[1, 1], [359, 320], [360, 320], [1279, 720], [1280, 720], [3840, 2160], [20_000, 20_000]];
    let scales = [1, 1, 2, 2, 3, 4, 7];
    assert_eq!(sizes.map(|size| Scales::Auto.of(size)), scales);
    assert_eq!(Scales::Fixed(5).of([1, 1]), 5);
}
