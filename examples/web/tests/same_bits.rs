//! The renders of the page as native code. `examples/web/test.mjs` checks that WebAssembly's are bit-identical.

use dapple::Filtered;
use dapple_web::{Demo, SIZE, denoised, encoded, fingerprint_of};

/// The fingerprints of both images at 8 spp with seed 7, and of the image denoised from buffers. They change with any change of
/// the default filter's output.
const FINGERPRINTS: &str = include_str!("../fingerprints.txt");

fn rendered(spp: u32, seed: u32) -> Demo {
    let mut demo = Demo::new(spp, seed).unwrap();
    for which in 0..2 {
        // Steps until no new image appears.
        while demo.step(which, 1000).unwrap() {}
    }
    demo
}

#[test]
fn the_default_pair_is_nearer_to_the_reference_with_the_same_bits_everywhere() {
    let demo = rendered(8, 7);
    let file = image::open(concat!(env!("CARGO_MANIFEST_DIR"), "/page/reference.png")).unwrap().into_rgb8();
    assert_eq!([file.width(), file.height()], SIZE);
    let error = |image: &Filtered| {
        let image = image.radiance.iter().flatten().map(|x| f64::from(encoded(*x)));
        image.zip(file.as_raw()).map(|(x, r)| (x - f64::from(*r)).powi(2)).sum::<f64>() / file.as_raw().len() as f64
    };
    let errors = [0, 1].map(|which| error(demo.image(which)));
    assert!(errors[1] < 0.15 * errors[0], "{errors:?}");
    let images = [demo.image(0), demo.image(1), &denoised().unwrap()];
    assert!(error(images[2]) < 0.4 * error(images[0]), "{}", error(images[2]));
    let found = images.map(|image| fingerprint_of(image).to_string()).join(" ");
    if std::env::var_os("DAPPLE_UPDATE").is_some() {
        std::fs::write(concat!(env!("CARGO_MANIFEST_DIR"), "/fingerprints.txt"), found + "\n").unwrap();
    } else {
        assert_eq!(found, FINGERPRINTS.trim());
    }
}

#[test]
#[ignore = "T2: makes the reference of the page, some minutes"]
fn the_reference_is_made() {
    let demo = rendered(2048, 1);
    let bytes = demo.image(0).radiance.iter().flatten().map(|x| encoded(*x)).collect();
    let image = image::RgbImage::from_raw(SIZE[0], SIZE[1], bytes).unwrap();
    image.save(concat!(env!("CARGO_MANIFEST_DIR"), "/page/reference.png")).unwrap();
}
