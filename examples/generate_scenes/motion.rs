//! A scene of motion blur: a mill turns, a ball rolls and dice fall while the shutter is open.

use std::fmt::Write;

/// Rotation of the mill while the shutter is open, in degrees.
const TURN: f64 = 20.0;
/// The x coordinate of the rolling ball when the shutter opens, and when it closes.
const ROLL: [f64; 2] = [0.1, 0.45];
const BALL: f64 = 0.55;

/// The dice: x, height when the shutter closes, distance fallen and degrees turned while the shutter is open.
const DICE: [(f64, f64, f64, f64); 3] = [(1.2, 2.7, 0.0, 0.0), (2.2, 2.0, 0.2, 12.0), (3.2, 1.1, 0.4, 24.0)];

/// Returns the text of the motion scene's file.
pub(super) fn scene() -> String {
    let mut text = include_str!("motion.pbrt").to_owned();
    for blade in 0..4 {
        let _ = write!(
            text,
            "\nAttributeBegin\n  Translate -2 0 2\n  Rotate {} 0 1 0\n  ActiveTransform EndTime\n  \
             Rotate {TURN} 0 1 0\n  ActiveTransform All\n  ObjectInstance \"blade\"\nAttributeEnd\n",
            20 + 90 * blade
        );
    }
    let [from, to] = ROLL;
    // It rolls without slipping, 180 / pi degrees for each radius; its poles lie along the axis that it turns about.
    let turn = (to - from) / BALL * (180.0 / std::f64::consts::PI);
    let _ = write!(
        text,
        "\n# A ball that rolls to the right.\nAttributeBegin\n  Translate {from} -2 {BALL}\n  ActiveTransform EndTime\n  \
         Translate {} 0 0\n  Rotate {turn:.3} 0 1 0\n  ActiveTransform All\n  Rotate 60 1 0 0.3\n  NamedMaterial \"ball\"\n  \
         Shape \"sphere\" \"float radius\" [ {BALL} ]\nAttributeEnd\n",
        to - from
    );
    for (x, z, fallen, turn) in DICE {
        let moves = match fallen > 0.0 {
            true => format!(
                "  ActiveTransform EndTime\n  Translate 0 0 {}\n  Rotate {turn} 1 0.4 0.2\n  ActiveTransform All\n",
                -fallen
            ),
            false => String::new(),
        };
        let _ = write!(
            text,
            "\nAttributeBegin\n  Translate {x} 0 {}\n{moves}  Rotate 35 0.3 0.2 1\n  Scale 0.38 0.38 0.38\n  \
             ObjectInstance \"die\"\nAttributeEnd\n",
            z + fallen
        );
    }
    text
}
