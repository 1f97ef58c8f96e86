//! The search for layers by their names, in parts, view layers and views.

use dapple_scene::image::{
    ExrChannel, ExrPart, FoundLayer, LayerKind, LayerKind::*, Layers, NoImage, Purpose, Purpose::*,
};
use std::convert::Infallible;

/// A part with these channels, separated by blanks; `~` stands for a blank in a name.
fn part(name: &str, channels: &str) -> ExrPart {
    let channel = |name: &str| ExrChannel { name: name.replace('~', " "), values: "float" };
    let channels = channels.split_ascii_whitespace().map(channel).collect();
    ExrPart { name: name.into(), channels, ..ExrPart::default() }
}

fn in_view(view: &str, part: ExrPart) -> ExrPart {
    ExrPart { view: Some(view.into()), ..part }
}

/// `LAYER.R LAYER.G LAYER.B` for each of these layers; `=` is no layer.
fn rgb(layers: &str) -> String {
    let channel = |layer: &str, letter: &str| if layer == "=" { letter.into() } else { format!("{layer}.{letter}") };
    let layers = layers.split(' ').flat_map(|layer| ["R", "G", "B"].map(|letter| channel(layer, letter)));
    layers.collect::<Vec<String>>().join(" ")
}

/// The chosen image of parts, where the layers `zero` are 0 everywhere, or `A | B` for an ambiguous choice.
fn image(parts: &[ExrPart], purpose: Purpose, zero: &[&str]) -> String {
    let is_zero = |layer: &FoundLayer| Ok::<_, Infallible>(zero.contains(&layer.name.as_str()));
    match Layers::of(parts).image(purpose, is_zero).unwrap() {
        Ok(chosen) => chosen.layer.shown(),
        Err(NoImage::Ambiguous(names)) => names.join(" | "),
        Err(NoImage::Missing) => "none".into(),
    }
}

/// The layer of a kind that belongs to the image to be denoised, with its channels.
fn guide(parts: &[ExrPart], kind: LayerKind) -> Option<String> {
    let layers = Layers::of(parts);
    let image = layers.image(Denoising, |_| Ok::<_, Infallible>(false)).unwrap().expect("an image").layer;
    let found = layers.guide(kind, &image)?;
    let names = found.channels.iter().map(|&channel| parts[found.part].channels[channel].name.clone());
    let letters = names.map(|name| name.rsplit('.').next().unwrap_or_default().to_owned());
    Some(format!("{}:{}", found.name, letters.collect::<Vec<_>>().join("")))
}

#[test]
fn an_image_without_a_layer_comes_first_then_those_named_as_images() {
    let cases: [(&str, &str, &str); 15] = [
        ("R G B AO.R AO.G AO.B", "R, G, B", "R, G, B"),
        ("R G B unfiltered.R unfiltered.G unfiltered.B", "unfiltered", "R, G, B"),
        (
            "V.Combined.R V.Combined.G V.Combined.B V.Noisy~Image.R V.Noisy~Image.G V.Noisy~Image.B",
            "V.Noisy Image",
            "V.Combined",
        ),
        ("AO.R AO.G AO.B beauty.r beauty.g beauty.b", "beauty", "beauty"),
        ("albedo.R albedo.G albedo.B color.red color.green color.blue", "color", "color"),
        ("r g b", "R, G, B", "R, G, B"),
        ("Y Z", "Y", "Y"),
        ("X Y Z", "none", "none"),
        ("RGBA.Y RGBA.A", "RGBA", "RGBA"),
        ("Y beauty.R beauty.G beauty.B", "beauty", "beauty"),
        ("albedo.R albedo.G albedo.B", "none", "albedo"),
        ("AO.R AO.G AO.B albedo.R albedo.G albedo.B", "none", "AO | albedo"),
        ("depth.Z one.Y", "none", "one"),
        ("depth.Y one.Y", "none", "depth | one"),
        ("m2_img.R m2_img.G m2_img.B img.R img.G img.B", "none", "img"),
    ];
    for (channels, denoising, showing) in cases {
        let parts = [part("", channels)];
        assert_eq!(image(&parts, Denoising, &[]), denoising, "{channels}");
        assert_eq!(image(&parts, Showing, &[]), showing, "{channels}");
    }
}

#[test]
fn several_view_layers_are_ambiguous_unless_the_others_are_zero() {
    let both = [part("", &rgb("Front.Combined Back.Combined"))];
    for purpose in [Denoising, Showing] {
        assert_eq!(image(&both, purpose, &[]), "Front.Combined | Back.Combined");
        assert_eq!(image(&both, purpose, &["Back.Combined"]), "Front.Combined");
        assert_eq!(image(&both, purpose, &["Front.Combined"]), "Back.Combined");
    }
    let composite = [part("", &rgb("Composite.Combined Layer.Combined"))];
    assert_eq!(image(&composite, Denoising, &[]), "Layer.Combined");
    assert_eq!(image(&composite, Showing, &[]), "Composite.Combined");
    assert_eq!(image(&composite, Showing, &["Composite.Combined"]), "Layer.Combined");
    let plain = [part("", &rgb("= Layer.Combined"))];
    assert_eq!(image(&plain, Denoising, &[]), "R, G, B");
    assert_eq!(image(&plain, Denoising, &[""]), "Layer.Combined");
    let nested = [part("", &rgb("= beauty"))];
    for purpose in [Denoising, Showing] {
        assert_eq!(image(&nested, purpose, &[""]), "beauty", "an empty image gives way to others of its view layer");
        assert_eq!(image(&nested, purpose, &["", "beauty"]), "R, G, B");
    }
    // The only image is read even if it is black.
    assert_eq!(image(&[part("", "R G B")], Showing, &[""]), "R, G, B");
}

#[test]
fn guides_come_from_the_view_layer_of_the_image() {
    let one = |channels: &str| [part("", channels)];
    let front = |rest: &str| one(&format!("{} {rest}", rgb("Front.Combined")));
    let n = "N.X N.Y N.Z";
    assert_eq!(guide(&front("Back.N.X Back.N.Y Back.N.Z"), Normal), None);
    assert_eq!(
        guide(&front("Back.N.X Back.N.Y Back.N.Z Front.N.X Front.N.Y Front.N.Z"), Normal).as_deref(),
        Some("Front.N:XYZ")
    );
    assert_eq!(guide(&front(n), Normal).as_deref(), Some("N:XYZ"), "a layer above that no other image owns");
    let both = one(&format!("{} img.N.X img.N.Y img.N.Z", rgb("=")));
    assert_eq!(guide(&both, Normal).as_deref(), Some("img.N:XYZ"), "the only one below");
    let two = one(&format!("{} a.N.X a.N.Y a.N.Z b.N.X b.N.Y b.N.Z", rgb("=")));
    assert_eq!(guide(&two, Normal), None, "either may be meant");
    let owned = one(&format!("{} {}", rgb("= Front.Combined Back.Combined"), "Front.N.X Front.N.Y Front.N.Z"));
    assert_eq!(guide(&owned, Normal), None);
}

#[test]
fn guides_are_found_by_their_known_names_best_first() {
    let cases: [(&str, LayerKind, Option<&str>); 17] = [
        ("RelativeVariance.R RelativeVariance.G RelativeVariance.B", Variance, None),
        ("VARIANCE.r VARIANCE.g VARIANCE.b", Variance, Some("VARIANCE:rgb")),
        ("variance", Variance, Some("variance:variancevariancevariance")),
        ("variance.V", Variance, Some("variance:VVV")),
        ("variance.Y variance.A", Variance, Some("variance:YYY")),
        ("mse.red mse.green mse.blue", MeanVariance, Some("mse:redgreenblue")),
        ("N.X N.Y N.Z Ns.X Ns.Y Ns.Z", Normal, Some("Ns:XYZ")),
        ("Nx Ny Nz", Normal, Some("N:NxNyNz")),
        ("Nx Ny", Normal, None),
        ("P.X P.Y P.Z", Depth, None),
        ("Z", Depth, Some("Z:Z")),
        ("A.Depth.Z A.Denoising~Depth.Z", Depth, Some("A.Denoising Depth:Z")),
        ("m2_a.X m2_a.Y m2_a.Z a.X a.Y a.Z", SecondMoment, Some("m2_a:XYZ")),
        ("i.m2_a.X i.m2_a.Y i.m2_a.Z i.a.X i.a.Y i.a.Z", SecondMoment, Some("i.m2_a:XYZ")),
        ("m2_nn.X m2_nn.Y m2_nn.Z nn.X nn.Y nn.Z", SecondMoment, None),
        ("a.m2_nn.X a.m2_nn.Y a.m2_nn.Z nn.X nn.Y nn.Z", Normal, Some("nn:XYZ")),
        ("m2_albedo.R m2_albedo.G m2_albedo.B", Albedo, None),
    ];
    for (channels, kind, expected) in cases {
        let file = part("", &format!("R G B {channels}"));
        assert_eq!(guide(&[file], kind).as_deref(), expected, "{kind:?} in {channels}");
    }
}

#[test]
fn parts_are_layers_or_view_layers_by_their_names() {
    let rgb = "R G B";
    let xyz = "X Y Z";
    let cases: [(Vec<ExrPart>, &str, Option<&str>); 7] = [
        (vec![part("rgba", rgb), part("N", xyz)], "rgba", Some("N:XYZ")),
        (vec![part("main", rgb), part("normal", xyz)], "main", Some("normal:XYZ")),
        (vec![part("main", rgb), part("data", "N.X N.Y N.Z")], "main", Some("data.N:XYZ")),
        (vec![part("rgba", "rgba.R rgba.G rgba.B"), part("N", "N.X N.Y N.Z")], "rgba", Some("N:XYZ")),
        (vec![part("Front", "R G B N.X N.Y N.Z"), part("depth", "Z")], "Front", Some("Front.N:XYZ")),
        (vec![part("Front.Combined", rgb), part("Front.Normal", xyz)], "Front.Combined", Some("Front.Normal:XYZ")),
        (vec![part("diffuse_albedo", rgb), part("beauty", rgb)], "beauty", None),
    ];
    for (parts, color, normal) in cases {
        assert_eq!(image(&parts, Denoising, &[]), color, "{parts:?}");
        assert_eq!(guide(&parts, Normal).as_deref(), normal, "{parts:?}");
    }
    let two = [part("Front", "R G B N.X N.Y N.Z"), part("Back", "R G B N.X N.Y N.Z")];
    assert_eq!(image(&two, Showing, &[]), "Front | Back");
    assert_eq!(image(&two, Showing, &["Back"]), "Front");
}

#[test]
fn views_are_found_by_header_part_or_name_and_have_guides_of_their_own() {
    let listed = |channels: &str| ExrPart { views: vec!["main".into(), "aux".into()], ..part("", channels) };
    let cases: [(Vec<ExrPart>, [&str; 2], [&str; 2]); 4] = [
        (
            vec![part("", "R G B N.X N.Y N.Z right.R right.G right.B N.right.X N.right.Y N.right.Z")],
            ["", "right"],
            ["N", "N.right"],
        ),
        (vec![listed("R G B N.X N.Y N.Z aux.R aux.G aux.B N.aux.X N.aux.Y N.aux.Z")], ["", "aux"], ["N", "N.aux"]),
        (
            vec![part(
                "",
                "left.R left.G left.B right.R right.G right.B left.N.X left.N.Y left.N.Z right.N.X right.N.Y right.N.Z",
            )],
            ["left", "right"],
            ["left.N", "right.N"],
        ),
        (
            vec![
                in_view("l", part("rgba.l", "R G B")),
                in_view("r", part("rgba.r", "R G B")),
                in_view("r", part("N-r", "X Y Z")),
                in_view("l", part("N-l", "X Y Z")),
            ],
            ["rgba.l", "rgba.r"],
            ["N-l", "N-r"],
        ),
    ];
    for (parts, colors, normals) in cases {
        let layers = Layers::of(&parts);
        let image = layers.image(Denoising, |_| Ok::<_, Infallible>(false)).unwrap().expect("an image").layer;
        let (views, missing) = layers.in_all_views(&image);
        assert_eq!(views.iter().map(|layer| layer.name.as_str()).collect::<Vec<_>>(), colors, "{parts:?}");
        assert!(missing.is_empty());
        let found: Vec<_> = views.iter().map(|view| layers.guide(Normal, view).expect("a normal").name).collect();
        assert_eq!(found, normals, "{parts:?}");
    }
    // A view without a guide has none of another view.
    let parts = [part("", "R G B N.X N.Y N.Z right.R right.G right.B")];
    let layers = Layers::of(&parts);
    let right = layers.given(Color, "right").unwrap();
    assert_eq!((right.view.as_str(), layers.guide(Normal, &right)), ("right", None));
}

#[test]
fn names_of_the_caller_are_exact_or_but_for_case() {
    let layers = Layers::of(&[part("", "a.N.X a.N.Y a.N.Z noise.V other.C other.M Z")]);
    let channels = |kind: LayerKind, name: &str| layers.given(kind, name).map(|found| found.channels);
    assert_eq!(channels(Normal, "A.n"), Some(vec![0, 1, 2]));
    assert_eq!(channels(Depth, "z"), Some(vec![6]));
    assert_eq!(channels(Variance, "noise"), Some(vec![3; 3]));
    assert_eq!(channels(Depth, "noise.V"), Some(vec![3]));
    assert_eq!((channels(Color, "noise"), channels(Color, "z")), (Some(vec![3; 3]), Some(vec![6; 3])), "grey images");
    assert_eq!(channels(Normal, "a.M"), None);
    assert_eq!((channels(Color, "other"), layers.letters("other").join(" ")), (None, "C M".to_owned()));
    assert_eq!(layers.names(), ["a.N", "noise", "other", "Z"]);
}

#[test]
fn kinds_are_parsed_by_their_names() {
    assert!(LayerKind::all().all(|kind| kind.name().parse() == Ok(kind)));
    assert!("colour".parse::<LayerKind>().unwrap_err().contains("choose among color, variance"));
}
