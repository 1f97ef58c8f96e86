//! Handling of Ctrl-C and SIGTERM: the first signal stops the render and saves it, a second one ends the program at
//! once.

use crate::{Failure, Result};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// A flag that Ctrl-C or SIGTERM sets to request a stop. Clones share the flag.
#[derive(Clone, Debug, Default)]
pub(crate) struct Stop(Arc<AtomicBool>);

impl Stop {
    /// Installs the handler of Ctrl-C and SIGTERM; may be called once per process.
    pub(crate) fn listen() -> Result<Self> {
        let stop = Self::default();
        let asked = stop.clone();
        ctrlc::set_handler(move || {
            if asked.0.swap(true, Ordering::Relaxed) {
                // A second signal ends the program without waiting for files.
                #[allow(clippy::exit)]
                std::process::exit(130);
            }
        })
        .map_err(|e| Failure::new(format!("cannot listen for Ctrl-C: {e}")))?;
        Ok(stop)
    }

    pub(crate) fn asked(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}
