//! Messages of different lengths to and from process 0, for the tests: `mpirun -n 3 target/debug/examples/messages`.

use dapple_core::Error;
use dapple_distributed::Processes;

/// The bytes for process `rank`, which are sometimes empty.
fn bytes(rank: u32, round: u32) -> Vec<u8> {
    (0..rank * 7 * round).map(|k| (k * 31 + rank) as u8).collect()
}

fn main() -> Result<(), Error> {
    let mut processes = dapple_mpi::MpiProcesses::start()?;
    if let Some(limit) = std::env::args().nth(1).and_then(|n| n.parse().ok()) {
        processes = processes.with_bytes_at_once(limit);
    }
    let (me, of) = (processes.rank(), processes.size());
    for round in 0..4 {
        if me > 0 {
            let (from, got) = processes.receive()?;
            assert!(from == 0 && got == bytes(me, round));
            processes.send(0, &got)?;
            continue;
        }
        for rank in 1..of {
            processes.send(rank, &bytes(rank, round))?;
        }
        let mut got = (1..of).map(|_| processes.receive()).collect::<Result<Vec<_>, _>>()?;
        got.sort_unstable();
        assert!(
            got.iter().map(|(rank, _)| *rank).eq(1..of) && got.iter().all(|(rank, back)| *back == bytes(*rank, round))
        );
    }
    if std::env::args().nth(2).is_some_and(|victim| victim == me.to_string()) {
        std::process::abort();
    }
    // A process answers once for each message, so that no answer of a round meets one of the next.
    if me > 0 {
        processes.receive()?;
        return processes.send(0, &[1]);
    }
    (1..of).try_for_each(|rank| processes.send(rank, &[]))?;
    for _ in 1..of {
        processes.receive()?;
    }
    use std::io::Write as _;
    let _ = writeln!(std::io::stdout(), "{of} processes");
    Ok(())
}
