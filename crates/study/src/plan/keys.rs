//! The settings of a study, each declared in one place.
//!
//! From the declarations, a macro generates the fields, TOML keys, setters and merging of [`PlanPatch`], and the fields
//! of [`Plan`].

use super::{DEFAULT_REFERENCE_SPP, ScenePlan, default_lights, toml_file};
use crate::{External, Method};
use dapple_renderer::light::LightSelection;
use serde::Deserialize;

/// Makes [`PlanPatch`] and [`Plan`] from four lists. The first three hold settings: those that `PlanPatch::resolve`
/// combines, those without a default, and those with one. The fourth holds the fields of the plan that are computed.
macro_rules! settings {
    (
        combined { $($(#[$c_meta:meta])* $combined:ident: $c_type:ty,)* }
        optional { $($(#[$o_meta:meta])* $optional:ident: $o_type:ty,)* }
        defaulted { $($(#[$d_meta:meta])* $defaulted:ident: $d_type:ty = $default:expr,)* }
        computed { $($(#[$p_meta:meta])* $computed:ident: $p_type:ty,)* }
    ) => {
        /// A part of a study's settings. [`resolve`](Self::resolve) adds the defaults of the others, and makes a
        /// [`Plan`].
        ///
        /// Fields have the names of the TOML file's keys; `None` is a setting that is not set. Each field has a setter,
        /// and two patches can be merged.
        ///
        /// ```
        /// use dapple_study::PlanPatch;
        /// let file = PlanPatch::parse("spp = [8, 16]\nseeds = 4", "plan.toml".as_ref())?;
        /// let plan = file.merge(PlanPatch::default().spp(vec![32])).resolve()?;
        /// assert_eq!((plan.spp, plan.seeds), (vec![32], vec![1, 2, 3, 4]));
        /// # Ok::<(), dapple_study::PlanError>(())
        /// ```
        #[derive(Clone, Debug, Default, PartialEq, Deserialize)]
        #[serde(deny_unknown_fields, default)]
        #[non_exhaustive]
        pub struct PlanPatch {
            $($(#[$c_meta])* pub $combined: Option<$c_type>,)*
            $($(#[$o_meta])* pub $optional: Option<$o_type>,)*
            $($(#[$d_meta])* pub $defaulted: Option<$d_type>,)*
        }

        /// A complete plan of a study: every setting has a value, and is checked as far as possible without reading a
        /// scene.
        #[derive(Clone, Debug, PartialEq)]
        #[non_exhaustive]
        pub struct Plan {
            $($(#[$p_meta])* pub $computed: $p_type,)*
            $(
                #[doc = concat!("[`PlanPatch::", stringify!($optional), "`]; `None` where it is not set.")]
                pub $optional: Option<$o_type>,
            )*
            $(
                #[doc = concat!("[`PlanPatch::", stringify!($defaulted), "`] or its default.")]
                pub $defaulted: $d_type,
            )*
        }

        impl PlanPatch {
            setters! { $($combined: $c_type,)* $($optional: $o_type,)* $($defaulted: $d_type,)* }

            /// Returns this patch with its settings replaced by those that `other` sets.
            pub(super) fn replaced_by(self, other: Self) -> Self {
                Self {
                    $($combined: other.$combined.or(self.$combined),)*
                    $($optional: other.$optional.or(self.$optional),)*
                    $($defaulted: other.$defaulted.or(self.$defaulted),)*
                }
            }

            /// A plan with the settings that are copied unchanged; its computed fields are empty.
            pub(super) fn taken_over(&self) -> Plan {
                Plan {
                    $($computed: Default::default(),)*
                    $($optional: self.$optional.clone(),)*
                    $($defaulted: self.$defaulted.clone().unwrap_or($default),)*
                }
            }
        }
    };
}

macro_rules! setters {
    ($($name:ident: $type:ty,)*) => {
        $(
            #[doc = concat!("Sets [`", stringify!($name), "`](Self#structfield.", stringify!($name), "); `None` unsets it.")]
            #[must_use]
            pub fn $name(self, value: impl Into<Option<$type>>) -> Self {
                Self { $name: value.into(), ..self }
            }
        )*
    };
}

settings! {
    combined {
        /// The scenes; default [`DEFAULT_SCENES`](super::DEFAULT_SCENES).
        scenes: Vec<ScenePlan>,
        /// The samplers (how many samples each pixel gets), each combined with every point set and filter; default
        /// [`DEFAULT_SAMPLERS`](super::DEFAULT_SAMPLERS).
        samplers: Vec<String>,
        /// The point sets (where samples lie), each combined with every sampler and filter; default `sobol`.
        points: Vec<String>,
        /// The filters (denoisers), each combined with every sampler and point set; default
        /// [`DEFAULT_FILTERS`](super::DEFAULT_FILTERS).
        filters: Vec<String>,
        /// Methods (sampler, point set and filter) in addition to samplers x points x filters; the only methods if no
        /// samplers are set.
        #[serde(deserialize_with = "toml_file::methods")]
        methods: Vec<Method>,
        /// External programs, which methods can name as their filter; default none.
        #[serde(deserialize_with = "toml_file::externals")]
        external: Vec<External>,
        /// The method with which the others are compared; default uniform/sobol/none. It is added in front of the
        /// methods if it is not one of them.
        #[serde(deserialize_with = "toml_file::method")]
        baseline: Method,
        /// The budgets in mean samples per pixel; default [`DEFAULT_SPP`](super::DEFAULT_SPP).
        spp: Vec<u64>,
        /// The seeds, one run each per scene, method and budget; default 1 to [`DEFAULT_SEEDS`](super::DEFAULT_SEEDS).
        #[serde(deserialize_with = "toml_file::seeds")]
        seeds: Vec<u64>,
        /// The budget, one of `spp`, that sets the time of equal-time runs: every method gets the time that the
        /// baseline takes at this budget. 0 leaves out equal-time runs; default the second largest budget.
        time_of: u64,
        /// If true, defaults are smaller, for a study of less than a minute; default false.
        quick: bool,
    }
    optional {
        /// Width and height of images in pixels; default the size of a scene's reference file, else
        /// [`DEFAULT_SIDE`](super::DEFAULT_SIDE) for both.
        #[serde(deserialize_with = "toml_file::resolution")]
        resolution: [u32; 2],
        /// The largest number of scattering events between camera and light; default the limit in each scene.
        max_depth: u32,
    }
    defaulted {
        /// Samples per pixel of rendered reference images, from 2 to 2^32, rounded up to an even number; default
        /// [`DEFAULT_REFERENCE_SPP`].
        reference_spp: u64 = DEFAULT_REFERENCE_SPP,
        /// The rule by which light sampling selects one of several lights; default that of `dapple render`.
        lights: LightSelection = default_lights(),
        /// The number of threads, at most 1024; default 0, which is one per core.
        threads: usize = 0,
        /// If true, each run has a process of its own; default false.
        fresh: bool = false,
        /// If true, unsupported directives of scene files are warnings, not errors; default false.
        allow_unsupported: bool = false,
    }
    computed {
        /// The scenes in the order of their runs, at least one.
        scenes: Vec<ScenePlan>,
        /// The methods in the order of their runs, without repetitions.
        methods: Vec<Method>,
        /// The external programs that methods can name as their filter.
        external: Vec<External>,
        /// The method with which the others are compared, one of [`methods`](Self::methods).
        baseline: Method,
        /// The budgets in mean samples per pixel, ascending.
        spp: Vec<u64>,
        /// The seeds, without repetitions.
        seeds: Vec<u64>,
        /// The budget, one of `spp`, that sets the time of equal-time runs: the time that the baseline takes at this
        /// budget. `None` leaves out equal-time runs.
        time_of: Option<u64>,
        /// Width and height in pixels of a scene's images, if neither a resolution nor a reference file sets them.
        side: u32,
    }
}
