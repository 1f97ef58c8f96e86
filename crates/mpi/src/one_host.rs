//! The transport of messages between processes on one machine.

use std::ffi::OsString;

/// The variable and value that make Open MPI use shared memory, without a network search of 0.2 s.
const SHARED_MEMORY: (&str, &str) = ("OMPI_MCA_pml", "ob1");

/// The prefixes of variables that choose the transport or name a file of settings.
const CHOSEN: [&str; 4] = ["OMPI_MCA_pml", "OMPI_MCA_btl", "OMPI_MCA_mtl", "OMPI_MCA_mca_base"];

/// Makes Open MPI use shared memory if mpirun started all processes on this machine and the user has not chosen a transport, by
/// `--mca pml`, `btl` or `mtl`, a variable or a file of settings. Other MPI libraries do not read the variable.
///
/// MPI reads environment variables when it starts. This function does nothing if the process already has other threads.
pub(crate) fn prefer_shared_memory() {
    let of_user = std::env::home_dir().is_some_and(|home| home.join(".openmpi/mca-params.conf").exists());
    let alone = std::fs::read_dir("/proc/self/task").is_ok_and(|threads| threads.count() == 1);
    if alone && !of_user && is_one_host_without_choice(std::env::vars_os()) {
        let (name, value) = SHARED_MEMORY;
        #[expect(unsafe_code, reason = "MPI has no other way to take a setting")]
        // SAFETY: no other thread reads or writes the environment: Linux lists this thread only.
        unsafe {
            std::env::set_var(name, value);
        }
    }
}

/// Returns `true` if, according to `variables`, one launcher started all processes on this machine and the user chose no
/// transport.
fn is_one_host_without_choice(variables: impl Iterator<Item = (OsString, OsString)>) -> bool {
    let (mut all, mut here, mut chosen) = (None, None, false);
    for (name, value) in variables {
        let Some(name) = name.to_str() else { continue };
        match name {
            "OMPI_COMM_WORLD_SIZE" => all = Some(value),
            "OMPI_COMM_WORLD_LOCAL_SIZE" => here = Some(value),
            _ => chosen |= CHOSEN.iter().any(|setting| name.starts_with(setting)),
        }
    }
    all.is_some() && all == here && !chosen
}

#[cfg(test)]
mod tests {
    use super::*;

    fn is(variables: &[(&str, &str)]) -> bool {
        is_one_host_without_choice(variables.iter().map(|(name, value)| (name.into(), value.into())))
    }

    #[test]
    fn only_processes_of_one_machine_without_settings_take_shared_memory() {
        let all = ("OMPI_COMM_WORLD_SIZE", "2");
        let here = ("OMPI_COMM_WORLD_LOCAL_SIZE", "2");
        assert!(is(&[all, here, ("OMPI_MCA_orte_launch", "1")]));
        assert!(!is(&[all, ("OMPI_COMM_WORLD_LOCAL_SIZE", "1")]), "two machines");
        assert!(!is(&[all]) && !is(&[]), "another launcher");
        for chosen in ["OMPI_MCA_pml", "OMPI_MCA_btl", "OMPI_MCA_btl_tcp_if_include", "OMPI_MCA_mca_base_param_files"] {
            assert!(!is(&[all, here, (chosen, "x")]), "{chosen}");
        }
    }
}
