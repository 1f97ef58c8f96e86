//! Files that are written whole or not at all.

use dapple_scene::image::{Format, check_writable, write_file};
use std::fs;
use std::path::{Path, PathBuf};

fn names(folder: &Path) -> Vec<String> {
    let mut names: Vec<String> =
        fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().to_string_lossy().into_owned()).collect();
    names.sort();
    names
}

#[test]
fn files_are_replaced_whole_and_leave_nothing_behind() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["a.exr", "🎨 bild ü.exr", "no extension", ".exr"] {
        let path = folder.path().join(name);
        check_writable(&path).unwrap();
        assert!(!path.exists());
        write_file(&path, b"first").unwrap();
        check_writable(&path).unwrap();
        write_file(&path, b"2nd").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"2nd");
    }
    assert_eq!(names(folder.path()), [".exr", "a.exr", "no extension", "🎨 bild ü.exr"]);
}

#[test]
fn trouble_names_the_path_and_what_to_do() {
    let folder = tempfile::tempdir().unwrap();
    let there = folder.path().join("there.png");
    fs::write(&there, b"old").unwrap();
    let mut read_only = fs::metadata(&there).unwrap().permissions();
    read_only.set_readonly(true);
    fs::set_permissions(&there, read_only).unwrap();
    let cases = [
        (folder.path().join("missing/a.png"), "create the directory first"),
        (there.join("a.png"), "create the directory first"),
        (there.clone(), "change the permissions"),
        (folder.path().to_owned(), "choose another path"),
        (folder.path().join(format!("{}.png", "x".repeat(300))), "choose a shorter"),
        (PathBuf::new(), "choose another path"),
    ];
    for (path, advice) in cases {
        for error in [check_writable(&path).unwrap_err(), write_file(&path, b"x").unwrap_err()] {
            let message = error.to_string();
            assert!(message.contains(&*path.to_string_lossy()) && message.contains(advice), "{message}");
        }
    }
    assert_eq!(fs::read(&there).unwrap(), b"old");
    assert_eq!(names(folder.path()), ["there.png"]);
}

#[cfg(unix)]
#[test]
fn a_read_only_directory_is_refused() {
    use std::os::unix::fs::PermissionsExt;
    let folder = tempfile::tempdir().unwrap();
    let locked = folder.path().join("locked");
    fs::create_dir(&locked).unwrap();
    fs::set_permissions(&locked, fs::Permissions::from_mode(0o555)).unwrap();
    let path = locked.join("a.png");
    if fs::write(locked.join("probe"), b"").is_ok() {
        eprintln!("skipped: this user (root) may write to read-only directories");
    } else {
        assert!(check_writable(&path).unwrap_err().to_string().contains("change the permissions"));
        assert!(write_file(&path, b"x").is_err());
    }
    fs::set_permissions(&locked, fs::Permissions::from_mode(0o755)).unwrap();
}

#[cfg(target_os = "linux")]
#[test]
fn devices_are_written_to_and_never_replaced() {
    use std::os::unix::fs::{FileTypeExt, symlink};
    let is_device = |path: &str| fs::metadata(path).unwrap().file_type().is_char_device();
    if !(is_device("/dev/full") && is_device("/dev/null")) {
        eprintln!("skipped: no /dev/full");
        return;
    }
    check_writable(Path::new("/dev/null")).unwrap();
    write_file(Path::new("/dev/null"), b"x").unwrap();
    let message = write_file(Path::new("/dev/full"), b"x").unwrap_err().to_string();
    assert!(message.contains("/dev/full") && message.contains("free some space"), "{message}");
    assert!(is_device("/dev/full") && is_device("/dev/null"));

    let folder = tempfile::tempdir().unwrap();
    let link = folder.path().join("link.png");
    symlink("behind.png", &link).unwrap();
    for bytes in [b"1", b"2"] {
        write_file(&link, bytes).unwrap();
        assert_eq!(fs::read(folder.path().join("behind.png")).unwrap(), bytes);
    }
    assert!(fs::symlink_metadata(&link).unwrap().file_type().is_symlink());
}

#[test]
fn extensions_tell_the_format() {
    let of = |name: &str| Format::from_path(Path::new(name));
    assert_eq!(
        [of("a.exr").unwrap(), of("b/c.PFM").unwrap(), of("🎨.Png").unwrap()],
        [Format::Exr, Format::Pfm, Format::Png]
    );
    for name in ["a.jpg", "exr", ".png", "", "a."] {
        let message = of(name).unwrap_err().to_string();
        assert!(message.contains(".exr, .pfm or .png"), "{message}");
    }
}
