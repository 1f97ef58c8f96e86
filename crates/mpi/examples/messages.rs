//! Messages of different lengths between all processes, for the tests: `mpirun -n 3 target/debug/examples/messages`.

use dapple_core::{Error, Exchange};

/// The bytes that process `from` sends to process `to`, some of them none.
fn bytes(from: usize, to: usize, round: usize) -> Vec<u8> {
    (0..(from * 7 + to * 3) * round).map(|k| (k * 31 + from + to) as u8).collect()
}

fn main() -> Result<(), Error> {
    let mut processes = dapple_mpi::Processes::start()?;
    if let Some(limit) = std::env::args().nth(1).and_then(|n| n.parse().ok()) {
        processes = processes.with_bytes_at_once(limit);
    }
    let (me, of) = (processes.share().index() as usize, processes.share().of() as usize);
    for round in 0..4 {
        let all = processes.all_gather(bytes(me, 0, round))?;
        assert!((0..of).all(|from| all[from] == bytes(from, 0, round)) && all.len() == of);
        let all = processes.all_to_all((0..of).map(|to| bytes(me, to, round)).collect())?;
        assert!((0..of).all(|from| all[from] == bytes(from, me, round)) && all.len() == of);
    }
    if std::env::args().nth(2).is_some_and(|victim| victim == me.to_string()) {
        std::process::abort();
    }
    let all = processes.all_gather(vec![me as u8])?;
    assert_eq!(all.len(), of);
    if me == 0 {
        use std::io::Write as _;
        let _ = writeln!(std::io::stdout(), "{of} processes");
    }
    Ok(())
}
