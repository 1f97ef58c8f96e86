//! Tokens, colorimetry and polygons of readers. Their files use no others and are mounted here.
#![allow(dead_code, reason = "tests use a part of the mounted files")]

use approx::assert_abs_diff_eq;
use colorimetry::{Sampled, blackbody, blackbody_of_peak_one, rgb_of_chromaticity};
use glam::DVec3;
use polygon::triangulate;
use tokens::{Kind, Token, Tokens, number, unescape};

#[path = "../../src/pbrt/colorimetry.rs"]
mod colorimetry;
#[path = "../../src/polygon.rs"]
mod polygon;
#[path = "../../src/pbrt/tokens.rs"]
mod tokens;

fn words(text: &str) -> Vec<(Kind, &str, u32)> {
    let mut tokens = Tokens::new(text);
    std::iter::from_fn(|| tokens.next()).map(|t| t.unwrap()).map(|t| (t.kind, t.text, t.line)).collect()
}

#[test]
fn tokens_have_lines() {
    use Kind::{Close, Open, Text, Word};
    let text = "A[1 2]#c \"[\n\"b c\"-1\n\n# end\nZ";
    let kinds = [Word, Open, Word, Word, Close, Text, Word, Word];
    let texts = ["A", "[", "1", "2", "]", "b c", "-1", "Z"];
    let expected = kinds.into_iter().zip(texts).zip([1, 1, 1, 1, 1, 2, 2, 5]);
    assert!(words(text).into_iter().eq(expected.map(|((kind, text), line)| (kind, text, line))), "{:?}", words(text));
}

#[test]
fn strings_end_on_their_line() {
    let mut tokens = Tokens::new("\"ab\ncd");
    assert!(tokens.next().unwrap().unwrap_err().1.contains("closing quote"));
    assert_eq!(tokens.next().unwrap().unwrap().text, "cd");
    let token = |text| Token { kind: Kind::Text, text, line: 1 };
    assert_eq!(unescape(&token(r#"a\"b\\c\n"#)).unwrap(), "a\"b\\c\n");
    assert!(unescape(&token(r"a\q")).is_err());
    assert!(Tokens::new("\"a\\").next().unwrap().is_err());
    assert!(Tokens::new("\"a\\\"").next().unwrap().is_err());
}

#[test]
fn numbers_round_correctly_or_are_errors_i04() {
    let read = |text: &str| number(&Token { kind: Kind::Word, text, line: 3 });
    for (text, value) in [("1", 1.0), ("-0", -0.0), (".5", 0.5), ("+1.", 1.0), ("1e-50", 1e-50), ("1E+3", 1000.0)] {
        assert_eq!(read(text).unwrap().to_bits(), f64::to_bits(value), "{text}");
    }
    // A number of 1000 digits is rounded correctly: it lies just above a tie.
    let long = format!("9007199254740993.{}1", "0".repeat(1000));
    assert_eq!(read(&long).unwrap(), 9_007_199_254_740_994.0);
    for text in ["nan", "inf", "-inf", "Infinity", "1e400", "-1e400", "0x10", "1,5", "1e", "--1", ".", "1_0", "１"] {
        let (line, message) = read(text).unwrap_err();
        assert_eq!(line, 3);
        assert!(message.contains(text), "{message}");
    }
}

fn chromaticity(rgb: DVec3) -> [f64; 3] {
    let x = 0.412_390_8 * rgb.x + 0.357_584_3 * rgb.y + 0.180_480_8 * rgb.z;
    let y = 0.212_639 * rgb.x + 0.715_168_7 * rgb.y + 0.072_192_3 * rgb.z;
    let z = 0.019_330_8 * rgb.x + 0.119_194_8 * rgb.y + 0.950_532_2 * rgb.z;
    [x / (x + y + z), y / (x + y + z), y]
}

/// Compares black bodies with the Planckian locus of a standard table [CIE 15:2004]: 6500 K has
/// x = 0.3135, y = 0.3237; 2856 K (illuminant A) has x = 0.4476, y = 0.4074.
#[test]
fn black_bodies_have_their_colours() {
    for (kelvin, x, y) in [(6500.0, 0.3135, 0.3237), (2856.0, 0.4476, 0.4074)] {
        for (rgb, bright) in [(blackbody(kelvin), Some(1.0)), (blackbody_of_peak_one(kelvin), None)] {
            let [found_x, found_y, luminance] = chromaticity(rgb.unwrap());
            assert_abs_diff_eq!(found_x, x, epsilon = 0.0005);
            assert_abs_diff_eq!(found_y, y, epsilon = 0.0005);
            assert_abs_diff_eq!(luminance, bright.unwrap_or(luminance), epsilon = 1e-5);
            assert!(luminance <= 1.0 + 1e-5 && luminance > 0.1);
        }
    }
    assert!(blackbody(1e300).is_some());
    // Cold enough, the exponents overflow; that is refused rather than NaN.
    assert!(blackbody(1e-300).is_none());
}

#[test]
fn white_is_white() {
    let sampled = |numbers: &[f64]| Sampled::new(numbers).unwrap();
    let gray = sampled(&[200.0, 0.5, 900.0, 0.5]);
    assert!((gray.rgb_under_d65() - DVec3::splat(0.5)).length() < 1e-12, "{}", gray.rgb_under_d65());
    let white = rgb_of_chromaticity([0.3127, 0.3290]);
    assert!((white - DVec3::ONE).length() < 1e-3, "{white}");
    let equal = gray.rgb_of_luminance_one().unwrap();
    let [x, y, luminance] = chromaticity(equal);
    assert_abs_diff_eq!(x, 1.0 / 3.0, epsilon = 5e-4);
    assert_abs_diff_eq!(y, 1.0 / 3.0, epsilon = 5e-4);
    assert_abs_diff_eq!(luminance, 1.0, epsilon = 1e-5);
    // Half of that where it is only half as bright.
    assert!((gray.rgb() - equal * 0.5).length() < 1e-9);
    assert!(sampled(&[300.0, 0.0, 900.0, 0.0]).rgb_of_luminance_one().is_none());
}

#[test]
fn samples_are_joined() {
    let ramp = Sampled::new(&[400.0, 1.0, 500.0, 3.0]).unwrap();
    assert_eq!([300.0, 400.0, 425.0, 500.0, 700.0].map(|w| ramp.at(w)), [1.0, 1.0, 1.5, 3.0, 3.0]);
    assert_eq!((ramp.constant(), ramp.least()), (None, 1.0));
    for bad in [&[][..], &[400.0], &[500.0, 1.0, 400.0, 1.0], &[0.0, 1.0]] {
        assert!(Sampled::new(bad).is_err());
    }
}

fn cut(points: &[[f64; 2]]) -> Result<Vec<[u32; 3]>, &'static str> {
    // Tilted, so that no axis is special.
    let lift = |p: &[f64; 2]| DVec3::new(p[0] + 0.3 * p[1], p[1], 0.5 * p[0] - p[1]);
    let positions: Vec<DVec3> = points.iter().map(lift).collect();
    let corners: Vec<u32> = (0..points.len() as u32).collect();
    let mut triangles = Vec::new();
    triangulate(&corners, &positions, &mut triangles)?;
    let of = |corners: &[u32]| {
        let [first, ring @ ..] = corners else { return DVec3::ZERO };
        let from_first = |k: u32| positions[k as usize] - positions[*first as usize];
        ring.windows(2).map(|w| from_first(w[0]).cross(from_first(w[1])) * 0.5).sum::<DVec3>()
    };
    let sum: f64 = triangles.iter().map(|t| of(t).length()).sum();
    let whole = of(&corners);
    // Areas add up only if no triangle is turned around and none overlap.
    assert!((sum - whole.length()).abs() < 1e-9 * sum, "{sum} {whole}");
    assert!(triangles.iter().all(|t| of(t).dot(whole) >= 0.0));
    assert_eq!(triangles.len(), points.len() - 2);
    Ok(triangles)
}

#[test]
fn triangles_cover_a_polygon_once_i05() {
    let teeth = (0..40).map(|i| [f64::from(i / 2), if i % 4 < 2 { 5.0 } else { 1.0 }]);
    let comb: Vec<[f64; 2]> = teeth.chain([[19.0, 0.0], [0.0, 0.0]]).rev().collect();
    let square = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
    let dart = [[0.0, 0.0], [4.0, 0.0], [1.0, 1.0], [0.0, 4.0]];
    // A square hole joined to a square by a seam.
    let ring = [[0, 0], [3, 0], [3, 3], [0, 3], [0, 0], [1, 1], [1, 2], [2, 2], [2, 1], [1, 1]];
    let ring = ring.map(|point: [i32; 2]| point.map(f64::from));
    let straight = [[0.0, 0.0], [1.0, 0.0], [2.0, 0.0], [2.0, 2.0], [1.0, 0.5], [0.0, 2.0]];
    for polygon in [&comb[..], &square, &dart, &ring, &straight] {
        cut(polygon).unwrap();
    }
    // Negative control: a bow tie is not simple.
    assert!(cut(&[[0.0, 0.0], [2.0, 2.0], [2.0, 0.0], [0.0, 1.0]]).is_err());
}
