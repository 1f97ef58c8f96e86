//! The live image and the progress of `dapple render`: `--preview`, `--view` and plain lines.

use crate::common::{Folder, signal};
use std::io::Read;
use std::net::{TcpListener, TcpStream};
use std::thread::JoinHandle;

/// An image that tev would show: its size, and the values of its channels by name.
#[derive(Default)]
struct Shown {
    name: String,
    size: [usize; 2],
    channels: Vec<(String, Vec<f32>)>,
    updates: usize,
}

/// A reader of the fields of one packet.
struct Packet(Vec<u8>, usize);

impl Packet {
    fn receive(stream: &mut TcpStream) -> Option<Self> {
        let mut length = [0; 4];
        stream.read_exact(&mut length).ok()?;
        let mut bytes = vec![0; u32::from_le_bytes(length) as usize - 4];
        stream.read_exact(&mut bytes).expect("a whole packet");
        Some(Self(bytes, 0))
    }

    fn take<const N: usize>(&mut self) -> [u8; N] {
        self.1 += N;
        self.0[self.1 - N..self.1].try_into().expect("N bytes")
    }

    fn number(&mut self) -> usize {
        u32::from_le_bytes(self.take()) as usize
    }

    fn text(&mut self) -> String {
        let length = self.0[self.1..].iter().position(|&byte| byte == 0).expect("a zero byte");
        self.1 += length + 1;
        String::from_utf8(self.0[self.1 - length - 1..self.1 - 1].to_vec()).expect("UTF-8")
    }

    fn is_over(&self) -> bool {
        self.1 == self.0.len()
    }
}

impl Shown {
    /// Applies a packet: 4 creates an image, 6 updates a rectangle of some channels.
    fn apply(&mut self, mut packet: Packet) {
        let [kind, _focus] = packet.take();
        let name = packet.text();
        if kind == 4 {
            assert!(self.channels.is_empty(), "one image is created");
            (self.name, self.size) = (name, [packet.number(), packet.number()]);
            let channels = packet.number();
            let blank = vec![f32::NAN; self.size[0] * self.size[1]];
            self.channels = (0..channels).map(|_| (packet.text(), blank.clone())).collect();
            assert!(packet.is_over());
            return;
        }
        assert_eq!((kind, &name), (6, &self.name), "an update of the image");
        let names: Vec<String> = (0..packet.number()).map(|_| packet.text()).collect();
        let [x, y, width, height] = [(); 4].map(|()| packet.number());
        assert!(x == 0 && width == self.size[0] && y + height <= self.size[1]);
        let offsets: Vec<u64> = names.iter().map(|_| u64::from_le_bytes(packet.take())).collect();
        let strides: Vec<u64> = names.iter().map(|_| u64::from_le_bytes(packet.take())).collect();
        let mut values = Vec::new();
        while !packet.is_over() {
            values.push(f32::from_le_bytes(packet.take()));
        }
        for (c, name) in names.iter().enumerate() {
            let (_, plane) = self.channels.iter_mut().find(|(known, _)| known == name).expect("a created channel");
            for i in 0..width * height {
                plane[y * width + i] = values[offsets[c] as usize + i * strides[c] as usize];
            }
        }
        self.updates += 1;
    }

    fn plane(&self, name: &str) -> &[f32] {
        &self.channels.iter().find(|(known, _)| known == name).expect("the channel").1
    }
}

/// Plays tev: listens, and shows what one connection sends until it closes.
fn tev() -> (u16, JoinHandle<Shown>) {
    let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
    let port = listener.local_addr().expect("an address").port();
    let viewer = std::thread::spawn(move || {
        let (mut stream, _) = listener.accept().expect("a connection");
        let mut shown = Shown::default();
        while let Some(packet) = Packet::receive(&mut stream) {
            shown.apply(packet);
        }
        shown
    });
    (port, viewer)
}

#[test]
fn tev_shows_image_counts_and_error_up_to_the_final_image() {
    let folder = Folder::new();
    let (port, viewer) = tev();
    folder.done(&format!(
        "render tiny.pbrt --spp 64 --view tev:127.0.0.1:{port} --preview-every 0.001 --preview p.png -o a.pfm -o a.png"
    ));
    let shown = viewer.join().expect("no packet is wrong");
    assert_eq!((shown.name.as_str(), shown.size), ("tiny", [24, 16]));
    let names: Vec<&str> = shown.channels.iter().map(|(name, _)| name.as_str()).collect();
    assert_eq!(names, ["R", "G", "B", "count.Y", "error.Y"]);
    assert!(shown.updates >= 6, "an image on the way and the last one, three layers each: {}", shown.updates);
    assert_eq!(shown.plane("count.Y").iter().sum::<f32>(), 64.0 * 24.0 * 16.0);
    assert!(shown.plane("error.Y").iter().all(|e| e.is_finite() && *e >= 0.0));
    // The last image is the one in the files; PFM stores rows from the bottom.
    let pfm = folder.read("a.pfm");
    let pixels: Vec<f32> = pfm[pfm.len() - 24 * 16 * 12..]
        .chunks_exact(4)
        .map(|four| f32::from_le_bytes(four.try_into().expect("four")))
        .collect();
    for (c, name) in ["R", "G", "B"].iter().enumerate() {
        let plane = shown.plane(name);
        assert!((0..24 * 16).all(|i| plane[i] == pixels[((15 - i / 24) * 24 + i % 24) * 3 + c]), "{name}");
    }
    assert_eq!(folder.read("p.png"), folder.read("a.png"), "the last preview is the image");
    assert_eq!(folder.names(), ["a.pfm", "a.png", "p.png"], "no temporary file is left");
}

#[test]
fn without_a_viewer_nothing_is_rendered() {
    let folder = Folder::new();
    // A port that was free a moment ago.
    let port = TcpListener::bind("127.0.0.1:0").expect("a port").local_addr().expect("an address").port();
    let said = folder.says(&format!("render tiny.pbrt --view tev:127.0.0.1:{port}"), 1, &[]);
    let expected = format!("error: --view: cannot connect to tev at 127.0.0.1:{port} (");
    assert!(said.err.starts_with(&expected) && said.err.contains("start tev first"), "{}", said.err);
    assert!(folder.names().is_empty());
    folder.says("render tiny.pbrt --view mpv", 2, &["unknown viewer \"mpv\"; use tev, tev:HOST or tev:HOST:PORT"]);
}

/// A viewer that is closed early costs a warning.
#[test]
fn a_viewer_that_leaves_does_not_stop_the_render() {
    let folder = Folder::new();
    let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
    let port = listener.local_addr().expect("an address").port();
    let viewer = std::thread::spawn(move || drop(listener.accept()));
    let said = folder.run(&format!(
        "render cornell --resolution 80x60 --spp 64 --view tev:127.0.0.1:{port} --preview-every 0.005 -o a.pfm"
    ));
    viewer.join().expect("it listened");
    assert_eq!(said.status, Some(0), "{}", said.err);
    let lines: Vec<&str> = said.err.lines().filter(|line| line.starts_with("warning: --view: tev at ")).collect();
    assert_eq!(lines.len(), 1, "{}", said.err);
    assert!(lines[0].ends_with("rendering continues") && folder.names() == ["a.pfm"]);
}

#[test]
fn plain_lines_name_the_phases_in_order_and_the_error() {
    let folder = Folder::new();
    // Few pixels, so that predictions are due often, and many samples, so that rounds after the pilot last.
    let said = folder.says("render cornell --resolution 40x30 --spp 400 --progress-every 1e-6 -o a.pfm", 0, &[]);
    assert!(said.err.lines().all(|line| line.starts_with("progress: ")), "{}", said.err);
    let mut lines = said.err.lines();
    for parts in [
        &["reading, for "][..],
        &["building, for "],
        &["preparing the methods, for "],
        &["%, pilot, "],
        &["%, round ", " of 3, ", " spp, relMSE ", " unfiltered, ", " left"],
        &["filter, for "],
        &["writing, for "],
    ] {
        assert!(lines.any(|line| parts.iter().all(|part| line.contains(part))), "{parts:?}: {}", said.err);
    }
    // Short renders print none by themselves, and silent ones never do.
    for words in ["", "--quiet --progress-every 0.001", "--json --progress-every 0.001"] {
        assert_eq!(folder.run(&format!("render tiny.pbrt --spp 8 -o a.pfm {words}")).err, "", "{words}");
    }
}

/// A file that is rewritten while the render goes on, complete at each moment. Ctrl-C ends the render once three images
/// were seen.
#[cfg(unix)]
#[test]
fn a_preview_changes_while_rendering() {
    let folder = Folder::new();
    let words = "render cornell --resolution 160x120 --spp 60000 --preview p.png --preview-every 0.05 -o a.png -q";
    let mut child = folder.command(words).stderr(std::process::Stdio::null()).spawn().expect("it starts");
    let (start, mut seen) = (std::time::Instant::now(), Vec::<Vec<u8>>::new());
    while seen.len() < 3 {
        let is_running = child.try_wait().expect("a status").is_none();
        assert!(is_running && start.elapsed().as_secs() < 120, "{} images until then", seen.len());
        if let Ok(bytes) = std::fs::read(folder.path("p.png"))
            && seen.last() != Some(&bytes)
        {
            assert!(bytes.starts_with(b"\x89PNG\r\n\x1a\n") && bytes.ends_with(b"IEND\xaeB`\x82"), "{}", bytes.len());
            seen.push(bytes);
        }
        std::thread::sleep(std::time::Duration::from_millis(10));
    }
    signal(&child, "INT");
    assert_eq!(child.wait().expect("a status").code(), Some(130));
    let last = folder.read("a.png");
    assert!(folder.read("p.png") == last && seen[0] != last, "the last preview is the image, the first is not");
}

/// Whatever a scene reads is kept: its texture, its mesh, the description, and files under another name. No output replaces
/// another.
#[test]
fn outputs_replace_neither_inputs_nor_each_other() {
    let folder = Folder::new();
    folder.done("render tiny.pbrt --spp 1 --filter none -o texture.exr -o texture.png -o texture.pfm");
    let mesh = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
        element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n";
    folder.write("mesh.png", mesh);
    let more = ["png", "pfm", "exr"].map(|kind| {
        format!("Texture \"{kind}\" \"spectrum\" \"imagemap\" \"string filename\" \"texture.{kind}\"\nMaterial \"diffuse\" \"texture reflectance\" \"{kind}\"\nShape \"sphere\"\n")
    });
    let scene =
        crate::common::TINY.to_owned() + &more.concat() + "Shape \"plymesh\" \"string filename\" \"mesh.png\"\n";
    folder.write("all.pbrt", scene);
    folder.write("spec.png", r#"{"version":1,"scene":"all.pbrt"}"#);
    ["maps", "new"].iter().for_each(|name| std::fs::create_dir(folder.path(name)).expect("a folder"));
    #[cfg(unix)]
    std::os::unix::fs::symlink("all.pbrt", folder.path("link.png")).expect("a link");
    for (new, old) in [("hard.png", "texture.png"), ("scene.png", "all.pbrt"), ("maps/albedo.png", "mesh.png")] {
        std::fs::hard_link(folder.path(old), folder.path(new)).expect("a link");
    }
    let before: Vec<_> =
        folder.names().into_iter().filter(|n| n != "maps" && n != "new").map(|n| (folder.read(&n), n)).collect();
    let cases = [
        ("all.pbrt -o texture.exr", "--output texture.exr: the scene reads this file (texture.exr)"),
        ("all.pbrt -o ./texture.pfm", "--output ./texture.pfm: the scene reads this file (texture.pfm)"),
        ("all.pbrt -o mesh.png", "--output mesh.png: the scene reads this file (mesh.png)"),
        ("all.pbrt -o hard.png", "--output hard.png: the scene reads this file (texture.png)"),
        #[cfg(unix)]
        ("all.pbrt -o link.png", "--output link.png: the scene reads this file (all.pbrt); write to another"),
        ("all.pbrt -o scene.png", "--output scene.png: the scene reads this file (all.pbrt)"),
        ("all.pbrt -o a.png --preview hard.png", "--preview hard.png: the scene reads this file (texture.png)"),
        ("all.pbrt -o a.png --checkpoint mesh.png", "mesh.png"),
        ("all.pbrt -o a.pfm --maps maps", "--maps maps/albedo.png: the scene reads this file (mesh.png)"),
        ("--spec spec.png -o spec.png", "--output spec.png: --spec reads this file (spec.png)"),
        ("all.pbrt --preview p.png -o p.png", "--preview p.png: --output p.png is the same file"),
        ("all.pbrt -o a.pfm -o ./a.pfm", "--output ./a.pfm: --output a.pfm is the same file"),
        (
            "all.pbrt --maps new -o new/a.pfm -o new/../new/albedo.png",
            "--output new/../new/albedo.png is the same file",
        ),
        ("all.pbrt --maps new.pfm -o new.pfm", "--maps new.pfm: --output new.pfm is the same file; choose different"),
        ("all.pbrt --checkpoint a.pfm -o a.pfm", "--checkpoint a.pfm: --output a.pfm is the same file"),
        ("--spec spec.png -o texture.png", "--output texture.png: the scene reads this file (texture.png)"),
    ];
    for (words, message) in cases {
        folder.says(&format!("render {words}"), 1, &[message]);
        assert!(before.iter().all(|(bytes, name)| *bytes == folder.read(name)), "{words}");
        assert!(!folder.path("a.png").exists() && !folder.path("a.pfm").exists(), "{words}");
    }
    // The control: beside them, everything is written.
    folder.done("render all.pbrt --spp 1 -o a.png");
}

/// Files that never end and files that may not grow are errors, not hangs or signals.
#[cfg(target_os = "linux")]
#[test]
fn endless_inputs_and_limited_outputs_are_errors() {
    let folder = Folder::new();
    for (words, message) in [
        ("study /dev/zero", "/dev/zero: cannot read the plan: it is longer than 16.0 MiB"),
        ("render --spec /dev/zero", "/dev/zero: cannot read the file: it is longer than 1.0 MiB"),
    ] {
        folder.says(words, 1, &[message]);
    }
    let said = folder.limited("-f 4", "render tiny.pbrt --spp 1 --resolution 200x200 -o a.pfm -o a.png");
    assert_eq!(said.status, Some(1), "{}", said.err);
    assert!(said.err.contains("a.pfm: cannot write the file: ") && said.err.contains("(ulimit -f)"), "{}", said.err);
}
