//! Renders by several processes that a launcher starts.

#![expect(clippy::print_stderr, reason = "tests report what they skip")]

use crate::common::{Folder, Said};
use std::process::Command;

/// A launcher's variables, without a launcher: a program that cannot talk to the other processes must not render.
#[test]
fn a_program_without_mpi_refuses_to_be_one_of_several() {
    if cfg!(feature = "mpi") {
        return;
    }
    let folder = Folder::new();
    for (name, processes) in [("OMPI_COMM_WORLD_SIZE", "4"), ("PMI_SIZE", "2"), ("SLURM_STEP_NUM_TASKS", "3")] {
        let mut command = folder.command("render tiny.pbrt --spp 1 -o a.pfm");
        let said = Said::of(command.env(name, processes).output().expect("it runs"));
        assert!(said.status == Some(1) && said.err.contains("--features mpi"), "{}", said.err);
        assert!(said.err.contains(&format!("{processes} processes")), "{}", said.err);
        // One process of a launcher is alone, and so is one with --part.
        let one = folder.command("render tiny.pbrt --spp 1 -q -o a.pfm").env(name, "1").output().expect("it runs");
        assert!(one.status.success());
        std::fs::remove_file(folder.path("a.pfm")).expect("the image");
        let shard = "render tiny.pbrt --sampler uniform --spp 1 --part 1/2 -q -o a.shard";
        assert!(folder.command(shard).env(name, processes).output().expect("it runs").status.success());
    }
}

/// `mpirun -n N dapple WORDS`; `None` where the program has no MPI, or mpirun is not installed.
fn mpirun(folder: &Folder, processes: u32, words: &str) -> Option<Said> {
    if !cfg!(feature = "mpi") {
        eprintln!("skipped: cargo test -p dapple-cli --features mpi --test cli together, where MPI is installed");
        return None;
    }
    let mut command = Command::new("mpirun");
    command.args(["--allow-run-as-root", "--oversubscribe", "--bind-to", "none", "-n", &processes.to_string()]);
    command.arg(env!("CARGO_BIN_EXE_dapple")).args(words.split_whitespace()).current_dir(folder.path(""));
    match command.output() {
        Ok(output) => Some(Said::of(output)),
        Err(e) => {
            eprintln!("skipped: mpirun cannot be started ({e}); apt-get install openmpi-bin");
            None
        }
    }
}

#[test]
fn processes_of_mpirun_make_the_bits_of_one() {
    let folder = Folder::new();
    for (scene, more) in
        [("tiny.pbrt", ""), ("cornell", "--resolution 48x80"), ("many-lights", "--resolution 40x64 --error 0.05")]
    {
        let words = format!("render {scene} --spp 8 {more} -q");
        let words = if more.contains("--error") { words.replace("--spp 8 ", "") } else { words };
        folder.done(&format!("{words} -o one.pfm"));
        for processes in [2, 3] {
            let Some(said) = mpirun(&folder, processes, &format!("{words} -o all.pfm")) else { return };
            assert_eq!(said.status, Some(0), "{}", said.err);
            assert!(folder.read("one.pfm") == folder.read("all.pfm"), "{scene} by {processes} has other bits");
            std::fs::remove_file(folder.path("all.pfm")).expect("the image");
        }
    }
}

#[test]
fn only_the_first_process_prints() {
    let folder = Folder::new();
    let Some(said) = mpirun(&folder, 3, "render tiny.pbrt --spp 4 --json -o all.pfm") else { return };
    assert_eq!(said.out.trim().matches('\n').count(), 0, "one line: {}", said.out);
    let Some(said) = mpirun(&folder, 3, "render missing.pbrt --spp 4 -o all.pfm") else { return };
    assert_ne!(said.status, Some(0));
    assert_eq!(said.err.matches("error: missing.pbrt").count(), 1, "{}", said.err);
}

/// The number of a process that another one started.
fn child_of(parent: u32) -> Option<u32> {
    let stat = |entry: std::fs::DirEntry| {
        let text = std::fs::read_to_string(entry.path().join("stat")).ok()?;
        let of: u32 = text.rsplit_once(')')?.1.split_whitespace().nth(1)?.parse().ok()?;
        (of == parent).then(|| entry.file_name().to_string_lossy().parse().ok())?
    };
    std::fs::read_dir("/proc").ok()?.flatten().filter_map(stat).max()
}

#[test]
fn a_render_whose_process_was_killed_goes_on_with_another_number_of_processes() {
    let folder = Folder::new();
    let render = "render cornell --resolution 128x128 --spp 64 -q";
    let words = format!("{render} --checkpoint c --resume c -o all.pfm");
    let Some(_) = mpirun(&folder, 1, "--version") else { return };
    let mut command = Command::new("mpirun");
    command.args("--allow-run-as-root --oversubscribe --bind-to none -n 2".split(' '));
    command.arg(env!("CARGO_BIN_EXE_dapple")).args(words.split(' ')).current_dir(folder.path(""));
    let mut running = command.stderr(std::process::Stdio::null()).spawn().expect("mpirun starts");
    let began = std::time::Instant::now();
    while !folder.path("c").exists() {
        assert!(began.elapsed().as_secs() < 300 && running.try_wait().expect("a state").is_none(), "no checkpoint");
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    let victim = child_of(running.id()).expect("a process of mpirun");
    assert!(Command::new("kill").args(["-9", &victim.to_string()]).status().expect("kill").success());
    assert!(!running.wait().expect("it ends").success(), "the job ends with its process");
    assert!(!folder.path("all.pfm").exists(), "the render was over before the process was killed");
    let said = mpirun(&folder, 3, &words).expect("as before");
    assert_eq!(said.status, Some(0), "{}", said.err);
    folder.done(&format!("{render} -o one.pfm"));
    assert!(folder.read("one.pfm") == folder.read("all.pfm"), "the resumed image has other bits");
}
