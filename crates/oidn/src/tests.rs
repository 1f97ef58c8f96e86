//! Tests with a stand-in for the library, which needs nothing installed, and with OIDN itself where it is found.

#![allow(clippy::print_stderr, reason = "tests say when they skip")]

use crate::library::Images;
use crate::{Library, LoadError, Oidn, OidnBlend, OidnOptions, RunError, VARIABLE};
use dapple_core::options::Options as _;
use dapple_core::{Error, Estimate, Film, Filter, Frame, Needs, Unfiltered, filter::ImagePlanes};
use dapple_denoise::Gaussian;
use std::ffi::OsStr;
use std::path::Path;
use std::process::Command;
use std::sync::OnceLock;
use tempfile::TempDir;

/// Compiles the stand-in with these `--cfg` flags into a folder.
fn compiled(flags: &[&str]) -> TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("src/tests/stand_in.rs");
    let name = if cfg!(windows) { "OpenImageDenoise.dll" } else { "libOpenImageDenoise.so" };
    let name = if cfg!(target_vendor = "apple") { "libOpenImageDenoise.dylib" } else { name };
    let rustc = std::env::var_os("RUSTC").unwrap_or_else(|| "rustc".into());
    let mut command = Command::new(rustc);
    command.args(["--edition", "2024", "--crate-type", "cdylib", "--crate-name", "stand_in"]);
    command.args(flags.iter().flat_map(|flag| ["--cfg", flag]));
    let output = command.arg("-o").arg(folder.path().join(name)).arg(source).output().expect("rustc starts");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    folder
}

fn search(path: impl AsRef<OsStr>) -> Result<Library, LoadError> {
    Library::search(Some(path.as_ref()), &[])
}

/// The stand-in, which copies its input.
fn stand_in() -> &'static Library {
    static LIBRARY: OnceLock<Library> = OnceLock::new();
    LIBRARY.get_or_init(|| search(compiled(&[]).path()).unwrap_or_else(|e| panic!("{e}")))
}

fn copying() -> Oidn {
    Oidn::new(stand_in(), OidnOptions::default())
}

/// OIDN itself with the default options; `None`, with a message, if it is not found.
fn installed() -> Option<Oidn> {
    let library = Library::load().map_err(|e| eprintln!("skipped, since OIDN is missing: {e}")).ok()?;
    Some(Oidn::new(library, OidnOptions::default()))
}

fn frame(width: u32, height: u32) -> Frame {
    Frame::new(width, height).expect("not empty")
}

/// A film of one sample per pixel.
fn film(width: u32, height: u32, value: impl Fn(usize) -> f32) -> Film {
    let mut film = Film::new(frame(width, height), Needs::none().with_features());
    (0..film.frame().pixels()).for_each(|i| film.push_estimate(i, 0, &Estimate::new([value(i); 3])));
    film
}

/// A number in 0..1 from a hash of `i`.
fn noise(i: usize) -> f32 {
    let hash = (i as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    ((hash ^ (hash >> 29)).wrapping_mul(0xbf58_476d_1ce4_e5b9) >> 40) as f32 / (1 << 24) as f32
}

#[test]
fn a_missing_library_is_reported_with_the_variable_and_the_package() {
    let error = search("/nonesuch/libOpenImageDenoise.so").expect_err("there is none");
    assert!(matches!(error, LoadError::NotLoaded { .. }), "{error:?}");
    let text = error.to_string();
    assert!(text.starts_with("DAPPLE_OIDN = \"/nonesuch/libOpenImageDenoise.so\" cannot be loaded: "), "{text}");
    if cfg!(target_os = "linux") {
        assert!(text.contains("cannot be loaded: /nonesuch/libOpenImageDenoise.so: cannot open"), "{text}");
    }
    assert!(text.contains("install Open Image Denoise 2 (`pip install pyoidn`, "), "{text}");
    assert!(text.ends_with("set DAPPLE_OIDN to the path of the library if Dapple still does not find it"), "{text}");

    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("library.so");
    std::fs::write(&file, "text").expect("a file");
    for path in [folder.path(), &file] {
        assert!(matches!(search(path), Err(LoadError::NotLoaded { .. })), "{}", path.display());
    }
    match Library::search(None, &[]) {
        Ok(_) => eprintln!("skipped: the system has OIDN"),
        Err(error) => {
            assert!(matches!(error, LoadError::NotFound { .. }), "{error:?}");
            assert_eq!(search("").expect_err("an empty path is none"), error);
            assert!(error.to_string().contains(VARIABLE), "{error}");
        }
    }
}

#[test]
fn libraries_of_another_kind_or_version_are_refused() {
    let refused = |flag: &str| search(compiled(&[flag]).path()).expect_err(flag);
    assert!(matches!(refused("version3"), LoadError::Version { version: 3, .. }), "{:?}", refused("version3"));
    match refused("no_device") {
        LoadError::NoDevice { why, .. } => assert_eq!(why, "no such device"),
        other => panic!("{other:?}"),
    }
    if cfg!(all(target_os = "linux", target_env = "gnu")) {
        let error = search("libc.so.6").expect_err("it is no denoiser");
        assert!(error.to_string().starts_with("libc.so.6 lacks the function oidn"), "{error}");
        assert!(error.to_string().contains("older than version 2"), "{error}");
    }
}

#[test]
fn a_library_is_found_in_a_folder_and_below_its_lib() {
    let folder = compiled(&[]);
    assert!(search(folder.path()).is_ok());
    let outer = tempfile::tempdir().expect("a folder");
    std::fs::rename(folder.path(), outer.path().join("lib")).expect("moved");
    let found = search(outer.path()).expect("a library").to_string();
    assert!(found.contains("lib") && found.ends_with(", version 2.7.1"), "{found}");
}

/// Folders: beside the programs of `PATH`, as Homebrew and conda install it, and where pip does. Refused libraries are skipped.
#[test]
fn a_library_is_found_beside_programs_and_among_pythons_packages() {
    if Library::search(None, &[]).is_ok() {
        return eprintln!("skipped: the system has OIDN");
    }
    let (old, new) = (tempfile::tempdir().expect("a folder"), tempfile::tempdir().expect("a folder"));
    let programs = [&old, &new].map(|folder| folder.path().join("bin"));
    let move_to = |library: TempDir, folder: &Path| {
        std::fs::create_dir_all(folder.parent().expect("a parent")).expect("folders");
        std::fs::rename(library.path(), folder).expect("moved");
    };
    move_to(compiled(&["version3"]), &old.path().join("lib"));
    assert!(matches!(Library::search(None, &programs), Err(LoadError::Version { version: 3, .. })));
    move_to(compiled(&[]), &new.path().join("lib/python3.11/site-packages/pyoidn/oidn/lib"));
    let found = Library::search(None, &programs).expect("a library").to_string();
    assert!(found.contains("pyoidn") && found.ends_with(", version 2.7.1"), "{found}");
}

/// Without this check, the library would read or write beyond the images.
#[test]
fn images_of_the_wrong_size_never_reach_the_library() {
    let (input, mut output) = (vec![0.5; 3 * 4 * 2], vec![0.0; 3 * 4 * 2]);
    for (inputs, outputs) in [(24, 23), (23, 24), (0, 24), (24, 0)] {
        let inputs = vec![(c"color", &input[..inputs])];
        let output = &mut output[..outputs];
        let mut images = Images { size: [4, 2], inputs, output, hdr: true, clean: false };
        let refused = stand_in().denoise(&mut images, 1);
        assert!(matches!(refused, Err(RunError::Size { expected: 24, .. })), "{refused:?}");
    }
    let inputs = vec![(c"color", &input[..])];
    let mut images = Images { size: [4, 2], inputs, output: &mut output, hdr: true, clean: false };
    assert_eq!(stand_in().denoise(&mut images, 1), Ok(()));
    assert_eq!(output, input);
}

#[test]
fn errors_of_the_library_become_errors_of_the_filter() {
    let mut output = vec![0.0; 3];
    let mut images = Images { size: [1, 1], inputs: Vec::new(), output: &mut output, hdr: true, clean: false };
    assert_eq!(stand_in().denoise(&mut images, 1), Err(RunError::Reported("no input".into())));
    assert_eq!(stand_in().denoise(&mut images, 0), Err(RunError::Reported("no threads".into())));

    static LIBRARY: OnceLock<Library> = OnceLock::new();
    let library = LIBRARY.get_or_init(|| search(compiled(&["nan"]).path()).unwrap_or_else(|e| panic!("{e}")));
    let refused = Oidn::new(library, OidnOptions::default()).apply(&film(40, 40, |_| 0.5));
    let Err(Error::Other { source, .. }) = &refused else { panic!("{refused:?}") };
    assert_eq!(source.downcast_ref(), Some(&RunError::NotFinite(1)));
}

#[test]
fn parameters_are_described_and_checked() {
    assert_eq!(copying().describe(), "oidn:prefilter=true");
    let plain = Oidn::new(stand_in(), OidnOptions::parse("prefilter=false").expect("options"));
    assert_eq!(plain.describe(), "oidn:prefilter=false");
    let wrong = OidnOptions::parse("prefilter=maybe").expect_err("refused").to_string();
    assert_eq!(wrong, "prefilter = \"maybe\" is not valid; use true or false");
    assert_eq!(OidnBlend::new(plain, Gaussian::default()).describe(), "oidn-blend:prefilter=false,alpha=0.5,radius=4");
    assert_eq!(OidnBlend::new(plain, Unfiltered).describe(), "oidn-blend:prefilter=false");
}

#[test]
fn oidn_conforms_with_a_stand_in() {
    dapple_conformance::filter(|| Box::new(copying()));
    dapple_conformance::filter(|| Box::new(Oidn::new(stand_in(), OidnOptions::default().prefilter(false))));
    dapple_conformance::filter(|| Box::new(OidnBlend::new(copying(), Gaussian::default())));
}

#[test]
fn both_is_the_plain_mean_of_two_images() {
    let film = film(40, 33, |i| 8.0 * noise(i));
    let gaussian = Gaussian::default().apply(&film).expect("an image");
    let mean = OidnBlend::new(copying(), Gaussian::default()).apply(&film).expect("an image");
    assert_eq!((mean.size, mean.error), ([40, 33], None));
    for ((mean, a), b) in mean.radiance.iter().zip(&gaussian.radiance).zip(film.image()) {
        assert!((0..3).all(|c| (mean[c] - 0.5 * (a[c] + b[c])).abs() <= 1e-6 * mean[c]), "{mean:?} {a:?} {b:?}");
    }
    let [oidn, gaussian] = [copying().needs(), Gaussian::default().needs()];
    assert_eq!(OidnBlend::new(copying(), Gaussian::default()).needs(), oidn.and(gaussian));
}

#[test]
fn the_memory_of_both_covers_each_filter_beside_the_others_image() {
    let frame = frame(100, 50);
    let needs = Needs::none().with_features();
    let oidn = copying().memory(&frame, &needs);
    let both = OidnBlend::new(copying(), Unfiltered).memory(&frame, &needs);
    assert_eq!(oidn.applying, 5000 * (48 + 700) + (64 << 20));
    assert_eq!(copying().memory(&self::frame(1, 1), &needs).applying, 1024 * (48 + 700) + (64 << 20));
    let huge = copying().memory(&self::frame(65535, 65535), &needs).applying;
    assert_eq!(huge, 65535 * 65535 * 48 + (3064 << 20), "the library's own memory is limited");
    assert_eq!(both.applying, oidn.applying + frame.bytes(12));
    assert_eq!((oidn.image, both.image), (frame.bytes(12), frame.bytes(12)));
    let heavy = OidnBlend::new(copying(), Heavy).memory(&frame, &needs);
    assert_eq!(heavy.applying, u64::MAX);
}

/// A filter that takes all memory.
struct Heavy;

impl Filter for Heavy {
    fn name(&self) -> &str {
        "heavy"
    }

    fn memory(&self, frame: &Frame, _: &Needs) -> dapple_core::filter::FilterMemory {
        dapple_core::filter::FilterMemory::new(frame, 0, ImagePlanes::Radiance).at_least(u64::MAX)
    }

    fn apply(&self, film: &Film) -> Result<dapple_core::Filtered, Error> {
        Unfiltered.apply(film)
    }
}

/// Constant images stay constant to 50 %: those of one pixel change most.
#[test]
fn oidn_itself_conforms() {
    let Some(oidn) = installed() else { return };
    dapple_conformance::filter_within(0.5, || Box::new(oidn));
}

#[test]
fn oidn_itself_removes_noise() {
    let Some(oidn) = installed() else { return };
    let film = film(96, 64, |i| 2.0 * noise(i));
    let error = |image: &[[f32; 3]]| image.iter().map(|p| (p[1] - 1.0) * (p[1] - 1.0)).sum::<f32>();
    let [before, after] = [film.image(), oidn.apply(&film).expect("an image").radiance].map(|image| error(&image));
    assert!(after < 0.05 * before, "{after} of {before}");
    let mean = OidnBlend::new(oidn, Unfiltered).apply(&film).expect("an image").radiance;
    let half = error(&mean) / before;
    assert!((0.2..0.35).contains(&half), "{half}");
}

/// By itself, OIDN makes the whole image black beside 10^30, and brightens 10^10 twofold.
#[test]
fn lamps_keep_their_light_and_darken_nothing() {
    let Some(oidn) = installed() else { return };
    for lamp in [1e6, 1e10, 1e20, 1e30, f32::MAX] {
        let is_lamp = |i: usize| (30..34).contains(&(i % 64)) && (30..34).contains(&(i / 64));
        let film = film(64, 64, |i| if is_lamp(i) { lamp } else { 0.5 });
        let image = oidn.apply(&film).expect("an image").radiance;
        for (i, [_, found, _]) in image.iter().enumerate() {
            if is_lamp(i) {
                assert!((found / lamp - 1.0).abs() < 0.02, "{lamp}: {found}");
            } else if i % 64 < 20 {
                assert!((found - 0.5).abs() < 0.05, "{lamp}: {found} at {i}");
            }
        }
    }
}

#[test]
fn black_stays_black_and_dim_images_are_filtered_like_bright_ones() {
    let Some(oidn) = installed() else { return };
    assert!(oidn.apply(&film(40, 40, |_| 0.0)).expect("an image").radiance.iter().all(|p| *p == [0.0; 3]));
    let of = |factor: f32| oidn.apply(&film(64, 48, |i| factor * noise(i))).expect("an image").radiance;
    let bright = of(1.0);
    for exponent in [-100, -20, 20, 100] {
        let factor = 2.0_f32.powi(exponent);
        assert!(of(factor).iter().zip(&bright).all(|(a, b)| a.map(|v| v / factor) == *b), "2^{exponent}");
    }
}
