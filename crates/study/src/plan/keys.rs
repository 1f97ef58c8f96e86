//! All settings of a study, each declared once.
//!
//! The table below generates the fields, TOML keys, setters and merge of [`PlanPatch`]. It also generates the fields of
//! [`Plan`] that copy a setting unchanged.

use super::{DEFAULT_REFERENCE_SPP, ScenePlan, toml_file};
use crate::{External, Method};
use serde::Deserialize;

/// Makes [`PlanPatch`] and [`Plan`] from three lists: settings that `PlanPatch::resolve` combines, settings without a
/// default, and settings with one. A fourth list has the fields of the plan that are computed.
macro_rules! settings {
    (
        combined { $($(#[$c_meta:meta])* $combined:ident: $c_type:ty,)* }
        optional { $($(#[$o_meta:meta])* $optional:ident: $o_type:ty,)* }
        defaulted { $($(#[$d_meta:meta])* $defaulted:ident: $d_type:ty = $default:expr,)* }
        computed { $($(#[$p_meta:meta])* $computed:ident: $p_type:ty,)* }
    ) => {
        /// Some settings of a study; [`resolve`](Self::resolve) gives the others their defaults.
        ///
        /// Fields have the names of the TOML file's keys. Each has a setter, and two patches can be merged.
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

        /// A complete plan: every setting has a value, and is checked as far as possible without reading a scene.
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

            /// This patch, overridden by the settings of `other`.
            pub(super) fn replaced_by(self, other: Self) -> Self {
                Self {
                    $($combined: other.$combined.or(self.$combined),)*
                    $($optional: other.$optional.or(self.$optional),)*
                    $($defaulted: other.$defaulted.or(self.$defaulted),)*
                }
            }

            /// A plan with the settings that are copied unchanged; the computed fields are empty.
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
        /// Scenes; default [`DEFAULT_SCENES`](super::DEFAULT_SCENES).
        scenes: Vec<ScenePlan>,
        /// Samplers; default [`DEFAULT_SAMPLERS`](super::DEFAULT_SAMPLERS).
        samplers: Vec<String>,
        /// Point sets, each with every sampler and filter; default `sobol`.
        points: Vec<String>,
        /// Filters, each with every sampler and point set; default [`DEFAULT_FILTERS`](super::DEFAULT_FILTERS).
        filters: Vec<String>,
        /// Methods in addition to samplers x points x filters; the only ones if no samplers are set.
        #[serde(deserialize_with = "toml_file::methods")]
        methods: Vec<Method>,
        /// External programs that methods can name as their filter; default none.
        #[serde(deserialize_with = "toml_file::externals")]
        external: Vec<External>,
        /// The method that the others are compared with; default uniform/sobol/none. Added in front of the methods if
        /// it is not one of them.
        #[serde(deserialize_with = "toml_file::method")]
        baseline: Method,
        /// Budgets in samples per pixel; default [`DEFAULT_SPP`](super::DEFAULT_SPP).
        spp: Vec<u64>,
        /// Seeds; default 1 to [`DEFAULT_SEEDS`](super::DEFAULT_SEEDS).
        #[serde(deserialize_with = "toml_file::seeds")]
        seeds: Vec<u64>,
        /// The budget of `spp` whose time, taken by the baseline, equal-time runs get. 0 leaves them out; default the
        /// largest budget but one.
        time_of: u64,
        /// Smaller defaults, for a study of less than a minute; default false.
        quick: bool,
    }
    optional {
        /// Width and height in pixels; default those of a reference file, else [`DEFAULT_SIDE`](super::DEFAULT_SIDE)
        /// squared.
        #[serde(deserialize_with = "toml_file::resolution")]
        resolution: [u32; 2],
        /// Most scattering events between camera and light; default each scene's.
        max_depth: u32,
    }
    defaulted {
        /// Samples per pixel of rendered references, from 2 to 2^32, rounded up to an even number; default
        /// [`DEFAULT_REFERENCE_SPP`].
        reference_spp: u64 = DEFAULT_REFERENCE_SPP,
        /// Threads, at most 1024; default 0, one per core.
        threads: usize = 0,
        /// A process of its own for each run; default false.
        fresh: bool = false,
        /// Unsupported directives of a scene are warnings, not errors; default false.
        allow_unsupported: bool = false,
    }
    computed {
        /// Scenes in their order, at least one.
        scenes: Vec<ScenePlan>,
        /// Methods in their order, each once.
        methods: Vec<Method>,
        /// External programs that methods can name as their filter.
        external: Vec<External>,
        /// The method that the others are compared with, one of [`methods`](Self::methods).
        baseline: Method,
        /// Budgets in samples per pixel, ascending.
        spp: Vec<u64>,
        /// Seeds, each once.
        seeds: Vec<u64>,
        /// The budget of `spp` whose time equal-time runs get; `None` leaves them out.
        time_of: Option<u64>,
        /// Pixels along a side where neither a resolution nor a reference file gives a size.
        side: u32,
    }
}
