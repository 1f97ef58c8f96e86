//! Messages for errors and warnings of jobs, with advice that names command-line options. Hints for users of other renderers,
//! whose options and methods have other names.

use crate::Failure;
use clap::builder::StyledStr;
use clap::error::{ContextKind, ContextValue, ErrorKind};
use dapple_job::registry::{FILTERS, NOT_BUILT, POINTS, RegistryError, SAMPLERS};
use dapple_job::{JobError, SpecError, Warning, can_be_replayed};
use dapple_scene::ReadError;

impl From<JobError> for Failure {
    /// Converts an error of a job to a failure, with one line per line of the error's message.
    fn from(error: JobError) -> Self {
        of_job(&error)
    }
}

/// Converts an error of a job to a failure, with one line per line of the error's message.
pub(crate) fn of_job(error: &JobError) -> Failure {
    match error {
        JobError::Spec(error) => of_spec(error),
        JobError::Read(error) => of_reader(error),
        JobError::NoParts { part, why } => Failure::new(format!("--part {part}: {why}")),
        JobError::CheckpointExists { path } => {
            let with = format!("resume from it with --resume {},", path.display());
            Failure::new(error.to_string().replace("resume from it,", &with))
        }
        JobError::Memory { limit, .. } => {
            let simpler = if limit.is_given() { "raise --memory, or simplify the scene" } else { SIMPLER };
            let options = [
                ("lower the resolution", "lower --resolution"),
                ("leave the filter out", "use --filter none"),
                ("render crops", "render crops (--crop)"),
                ("render smaller crops", "render smaller crops (--crop)"),
                ("is the limit", "is the limit (--memory)"),
                ("is all the memory available", "is all the memory available (--memory SIZE sets another limit)"),
                (SIMPLER, simpler),
            ];
            Failure::new(options.iter().fold(error.to_string(), |text, (what, option)| text.replace(what, option)))
        }
        _ => Failure::lines(error),
    }
}

/// The advice for a scene that does not fit into memory.
const SIMPLER: &str = "simplify the scene, or use a machine with more memory";

/// Converts the problems of a scene file to a failure. For unsupported features it names the option that allows them.
pub(crate) fn of_reader(error: &ReadError) -> Failure {
    Failure::lines(&error.to_string().replace("or allow unsupported directives", "or pass --allow-unsupported"))
}

/// Converts an invalid description of a render to a failure that names the wrong command-line option.
pub(crate) fn of_spec(error: &SpecError) -> Failure {
    match error {
        SpecError::Field { field: "seconds", what } => Failure::usage("render", format!("--time: {what}")),
        SpecError::Field { field, what } => Failure::usage("render", format!("--{}: {what}", field.replace('_', "-"))),
        _ => Failure::lines(error),
    }
}

/// The text of a warning, with advice that names command-line options.
pub(crate) fn warning(warning: &Warning) -> String {
    match warning {
        Warning::ErrorNotReached { .. } => format!("{warning}; lower the sampler's threshold, or raise --max-spp"),
        Warning::RejectedSamples { first, .. } if can_be_replayed(first) => {
            let [x, y] = first.sample.pixel;
            let (spp, right, below) = (first.sample.index + 1, x + 1, y + 1);
            format!("{warning}; reproduce it with --sampler uniform --spp {spp} --crop {x},{y},{right},{below}")
        }
        _ => warning.to_string(),
    }
}

/// Options of pbrt, Mitsuba, Cycles and Blender that Dapple lacks, each with Dapple's counterpart.
const OPTIONS: &[(&[&str], &str)] = &[
    (&["--samples", "--sample-count", "--cycles-samples", "--pixelsamples"], "use --spp N, the mean per pixel"),
    (&["--cropwindow", "--pixelbounds", "--border"], "use --crop X0,Y0,X1,Y1, in pixels from the top left"),
    (&["--width", "--height", "--size", "--film-size"], "use --resolution WIDTHxHEIGHT"),
    (&["--scale", "--percentage", "--resolution-percentage"], "use --resolution 50%"),
    (&["--display-server", "--interactive", "--gui"], "use --view tev, or --preview FILE.png"),
    (&["--write-partial-images"], "use --preview FILE.png, or --checkpoint FILE"),
    (&["--denoise", "--use-denoising", "--denoising"], "images are denoised by default; --filter NAME chooses how"),
    (&["--no-denoise", "--no-denoising"], "use --filter none"),
    (&["--maxdepth", "--max-bounces", "--bounces", "--rr-depth"], "use --max-depth N"),
    (&["--adaptive-threshold", "--noise-threshold", "--error-threshold"], "use --error RELMSE"),
    (&["--time-limit", "--timeout", "--render-time"], "use --time SECONDS"),
    (&["--num-threads", "--thread-count", "--cores"], "use --threads N"),
    (&["--render-output", "--out", "--file"], "use --output FILE"),
    (&["--gpu", "--wavefront", "--device", "--cycles-device", "--optix", "--cuda"], "Dapple renders on the CPU only"),
    (&["--mode", "--variant"], "Dapple has one mode: linear RGB in 32-bit floats"),
    (&["--aov", "--aovs", "--passes"], "use --features, or --layers NAME,… for EXR files"),
];

/// pbrt's samplers that are point sets in Dapple, each with Dapple's most similar point set.
const POINT_SETS: &[(&[&str], &str)] = &[
    (&["paddedsobol", "owensobol", "02sequence", "ldsampler"], "sobol"),
    (&["pmj02bn"], "pmj02"),
    (&["independent", "pcg"], "random"),
    (&["multijitter", "orthogonal", "jittered"], "stratified"),
];

/// Adds a hint to clap's error about an option of another renderer.
pub(crate) fn add_to(mut error: clap::Error) -> clap::Error {
    if error.kind() != ErrorKind::UnknownArgument {
        return error;
    }
    if let Some(ContextValue::String(option)) = error.get(ContextKind::InvalidArg)
        && let Some(hint) = option_hint(option)
    {
        // An option whose name merely looks similar would mislead.
        error.remove(ContextKind::SuggestedArg);
        error.insert(ContextKind::Suggested, ContextValue::StyledStrs(vec![StyledStr::from(hint)]));
    }
    error
}

fn option_hint(option: &str) -> Option<&'static str> {
    let name = option.split(['=', ' ']).next().unwrap_or(option);
    OPTIONS.iter().find(|(names, _)| names.contains(&name)).map(|&(_, hint)| hint)
}

/// The message for an unknown sampler; for a point set it recommends `--points`.
pub(crate) fn sampler(given: &str, error: &RegistryError) -> String {
    let name = name(given);
    let ours = POINTS.iter().find(|entry| entry.is_called(&name)).map(|entry| entry.name);
    match ours.or_else(|| nearest(POINT_SETS, &name)) {
        Some(points) if is_unknown(error) => format!(
            "\"{name}\" is a point set, which decides where samples lie; use --points {points} (--sampler decides how many \
             samples each pixel gets)"
        ),
        _ => error.to_string(),
    }
}

/// The message for an unknown point set. It recommends `--sampler` for a sampler, and the most similar point set for another
/// renderer's name.
pub(crate) fn points(given: &str, error: &RegistryError) -> String {
    let name = name(given);
    let sampler = SAMPLERS.iter().find(|entry| entry.is_called(&name)).map(|entry| entry.name);
    match (sampler, nearest(POINT_SETS, &name)) {
        _ if !is_unknown(error) => error.to_string(),
        (Some(sampler), _) => format!("\"{name}\" decides how many samples each pixel gets; use --sampler {sampler}"),
        (None, Some(points)) => format!("{error}; the most similar to \"{name}\" is {points}"),
        (None, None) => error.to_string(),
    }
}

/// The message for an unknown filter. It recommends `--pixel-filter` for pixel filters, and the most similar filter for
/// another renderer's denoiser.
pub(crate) fn filter(given: &str, error: &RegistryError) -> String {
    let name = name(given);
    match name.as_str() {
        "box" | "triangle" | "mitchell" | "sinc" | "blackmanharris" | "blackman_harris" if is_unknown(error) => {
            format!(
                "\"{name}\" is a pixel filter (see --pixel-filter); --filter chooses the denoiser: {}",
                FILTERS.iter().map(|entry| entry.name).collect::<Vec<_>>().join(", ")
            )
        }
        "openimagedenoise" | "optix" | "nlmeans" if is_unknown(error) => {
            let ours = if name == "nlmeans" { "nlm" } else { "oidn" };
            let absent = NOT_BUILT.iter().find(|(absent, _)| *absent == ours);
            let build = |(_, feature): &(_, &str)| format!(", which needs a build with --features {feature}");
            format!("{error}; the most similar to \"{name}\" is {ours}{}", absent.map_or_else(String::new, build))
        }
        _ => error.to_string(),
    }
}

/// The message for an unknown integrator. For an integrator of another renderer it recommends the most similar one.
pub(crate) fn integrator(given: &str, error: &str) -> String {
    match name(given).as_str() {
        "volpath" | "simplevolpath" | "simplepath" | "randomwalk" | "direct" | "directlighting" | "whitted"
        | "cycles" | "prb" | "volpathmis" => {
            format!("{error}; use --integrator path, which handles media, glass and all lights")
        }
        "sppm" | "photonmap" | "ptracer" | "lightpath" => format!("{error}; use --integrator photons"),
        "mlt" | "pssmlt" => format!("{error}; use --integrator metropolis"),
        "igi" | "vpl" => format!("{error}; use --integrator instant"),
        "ao" | "ambientocclusion" => format!("{error}; use --integrator ambient-occlusion"),
        _ => error.to_owned(),
    }
}

fn name(given: &str) -> String {
    given.split(':').next().unwrap_or_default().trim().to_ascii_lowercase()
}

fn nearest(table: &[(&[&str], &'static str)], name: &str) -> Option<&'static str> {
    table.iter().find(|(names, _)| names.contains(&name)).map(|&(_, ours)| ours)
}

fn is_unknown(error: &RegistryError) -> bool {
    matches!(error, RegistryError::Unknown { .. })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Each hint names options and methods that Dapple has.
    #[test]
    fn hints_name_what_exists() {
        use clap::CommandFactory;
        let command = crate::Arguments::command();
        let render = command.find_subcommand("render").expect("it exists");
        let options: Vec<&str> = render.get_arguments().filter_map(clap::Arg::get_long).collect();
        for (theirs, hint) in OPTIONS {
            for word in hint.split([' ', ',', ';']).filter_map(|word| word.strip_prefix("--")) {
                assert!(options.contains(&word), "--{word}");
            }
            assert!(theirs.iter().all(|name| !options.contains(&name.trim_start_matches("--"))), "{theirs:?}");
        }
        assert!(POINT_SETS.iter().all(|(_, ours)| POINTS.iter().any(|entry| entry.name == *ours)));
    }
}
