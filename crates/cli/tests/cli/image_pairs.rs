//! Pairs of images: what one view, layer or file of a pair has and the other lacks.

use crate::common::Folder;
use crate::image_files::{DISPLAY, WINDOW, denoise, file, floats, noise, open, part, two};
use crate::made_exr::{Made, MadePart};
use dapple_scene::image::{Chromaticities, Encoding, Window, read_image};

/// A file of these channels, where those of a variance are 0.25.
fn with_variance(channels: &str, views: &[&str]) -> Made {
    let mut made = part("", WINDOW, channels, 0, 1);
    for (_, values) in made.channels.iter_mut().filter(|(name, _)| name.contains("variance")) {
        values.fill(0.25);
    }
    Made { views: views.iter().map(|view| (*view).to_owned()).collect(), ..file(vec![made]) }
}

#[test]
fn a_view_without_a_variance_stays_as_it_is_and_the_message_names_the_layer() {
    let folder = Folder::new();
    let channels = "R G B right.R right.G right.B variance.R variance.G variance.B";
    folder.write("a.exr", with_variance(channels, &["left", "right"]).bytes());
    let kept = "a.exr: there is no variance for \"right\" of view \"right\", so this image is not denoised";
    folder.says("denoise a.exr -o out.exr --spp 16", 0, &[kept]);
    let [a, out] = ["a.exr", "out.exr"].map(|name| open(&folder, name));
    assert_eq!(floats(&out, 0, "right.R"), floats(&a, 0, "right.R"));
    assert_ne!(floats(&out, 0, "R"), floats(&a, 0, "R"));
    let message = "a.exr: there is no variance for \"right\" of view \"right\" among the layers";
    folder.says("denoise a.exr -o none.exr --spp 16 --layer color=right", 1, &[message]);
    let channels = "Front.Combined.R Front.Combined.G Front.Combined.B Back.Combined.R Back.Combined.G \
                    Back.Combined.B Back.variance.R Back.variance.G Back.variance.B";
    folder.write("a.exr", with_variance(channels, &[]).bytes());
    let message = "a.exr: there is no variance for \"Front.Combined\" among the layers";
    folder.says("denoise a.exr -o none.exr --spp 16 --layer color=Front.Combined", 1, &[message]);
}

#[test]
fn a_channel_of_any_letter_is_a_grey_image_by_its_name() {
    let folder = Folder::new();
    let grey = |letter: &str| {
        let mut made = with_variance("Y variance", &[]);
        made.parts[0].channels[0].0 = letter.into();
        folder.write("a.exr", made.bytes());
        folder.done(&format!("denoise a.exr -o out.exr --spp 16 --layer color={letter}"));
        floats(&open(&folder, "out.exr"), 0, letter)
    };
    let luminance = grey("Y");
    assert_eq!(grey("I"), luminance);
    assert_ne!(luminance, floats(&open(&folder, "a.exr"), 0, "I"));
}

#[test]
fn alpha_of_the_second_file_alone_has_a_notice() {
    let folder = Folder::new();
    two(&folder, |seed| file(vec![part("", WINDOW, if seed == 1 { "R G B" } else { "A R G B" }, 0, seed)]));
    let said = denoise(&folder, "");
    let notice = "b.exr: its alpha is dropped, since a.exr has none; give b.exr first to keep the alpha";
    assert!(said.err.contains(notice), "{}", said.err);
    folder.done("denoise b.exr a.exr -o out.exr --spp 16");
    assert_eq!(floats(&open(&folder, "out.exr"), 0, "A"), floats(&open(&folder, "b.exr"), 0, "A"));
}

#[test]
fn flat_outputs_say_what_they_do_not_show() {
    let folder = Folder::new();
    let none = Chromaticities { red: [0.0; 2], green: [0.0; 2], blue: [0.0; 2], white: [0.0; 2] };
    two(&folder, |seed| Made { space: Some(none), ..file(vec![part("", WINDOW, "R G B", 0, seed)]) });
    let cut = format!(
        "out.pfm: the file holds pixels {WINDOW}, not the whole display window {DISPLAY}; write an EXR file as well"
    );
    let space = "out.pfm: its colours are not converted, because the input's chromaticities (";
    let said = folder.says("denoise a.exr b.exr -o out.pfm --spp 16", 0, &[&cut, space]);
    assert_eq!(said.err.matches("out.pfm").count(), 2, "{}", said.err);
    let pfm = read_image(&folder.read("out.pfm"), "out.pfm", Encoding::Auto).expect("an image");
    assert_eq!(pfm.size, WINDOW.size);
}

#[test]
fn advice_names_options_of_the_command_line() {
    let folder = Folder::new();
    let window = Window { origin: [0, 0], size: [64, 64] };
    let write = |name: &str, variance: f32| {
        let mut made: MadePart = part("", window, &format!("R G B {name}.R {name}.G {name}.B"), 0, 1);
        // Normal noise with the standard deviation 0.1 around 0.5, the same in each channel.
        for (name, values) in &mut made.channels {
            let color = |i: usize| 0.5 + 0.1 * normal(i);
            *values = (0..values.len()).map(|i| if name.len() == 1 { color(i) } else { variance }).collect();
        }
        folder.write("a.exr", Made::of(vec![made]).bytes());
    };
    let of_mean = 0.01;
    write("variance", of_mean);
    folder.says("denoise a.exr -o out.exr --spp 16", 0, &["not that of one sample; give --variance-of-mean"]);
    write("mse", of_mean * 16.0);
    folder.says("denoise a.exr -o out.exr --spp 16", 0, &["that of the mean; give --layer variance=mse"]);
    folder.write("b.exr", folder.read("a.exr"));
    let message = "b.exr: the image is identical to that of a.exr, so the noise cannot be estimated; give two renders with different seeds";
    folder.says("denoise a.exr b.exr -o out.exr --spp 16", 1, &[message]);
    folder.says("denoise a.exr -o out.exr --layer variance=", 2, &["\"variance=\" is not of the form KIND=NAME"]);
}

/// Normally distributed numbers, nearly, of variance 1.
fn normal(i: usize) -> f32 {
    (0..12).map(|k| noise(i as i32 % 64, i as i32 / 64, k)).sum::<f32>() - 6.0
}
