//! The same image from differently optimised builds.

use std::path::Path;
use std::process::Command;

/// Unoptimised, optimised and built for this machine's processor, the program writes the same bytes.
#[test]
#[ignore = "T2: builds the program three times, ten minutes"]
fn optimisation_changes_no_pixel_d04() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let folder = tempfile::tempdir().expect("a folder");
    let image = |name: &str, flags: &str, level: &str, profile: &str| -> Vec<u8> {
        let out = folder.path().join(format!("{name}.pfm"));
        let output = Command::new(env!("CARGO"))
            .args(["run", "--quiet", "--profile", profile, "-p", "dapple-cli", "--", "render", "cornell"])
            .args([
                "--resolution",
                "40x30",
                "--spp",
                "8",
                "--sampler",
                "adaptive:epsilon=0.01",
                "--filter",
                "cluster-regression",
                "-o",
            ])
            .arg(&out)
            .env("CARGO_TARGET_DIR", root.join("target/flavours").join(name))
            .env("RUSTFLAGS", flags)
            .env("CARGO_PROFILE_DEV_OPT_LEVEL", level)
            .current_dir(root)
            .output()
            .expect("cargo runs");
        assert!(output.status.success(), "{name}: {}", String::from_utf8_lossy(&output.stderr));
        std::fs::read(out).expect("an image")
    };
    let plain = image("plain", "", "1", "dev");
    assert!(plain == image("release", "", "1", "release"), "release is another image");
    assert!(
        plain == image("native", "-C target-cpu=native", "2", "dev"),
        "this machine's processor makes another image"
    );
}
