//! The publications and programs that methods come from.

/// The source of a method, which `docs/references.bib` lists in full.
pub(super) fn source(method: &str) -> &'static str {
    SOURCES.iter().find(|(name, _)| *name == method).map_or("Dapple", |&(_, source)| source)
}

const SOURCES: &[(&str, &str)] = &[
    // Samplers.
    ("variance", "Dapple; counts in proportion to deviations: Neyman 1934"),
    ("uniform", "none: the baseline"),
    (
        "adaptive",
        "Dapple (docs/results/adaptive.md); counts: Neyman 1934; error maps of filters: Rousselle et al. 2012",
    ),
    ("mitchell", "Mitchell, Generating Antialiased Images at Low Sampling Densities, SIGGRAPH 1987"),
    ("mitchell-pbrt", "pbrt, version 2: src/samplers/adaptive.cpp, by Pharr and Humphreys, 2010"),
    ("cycles", "Blender's Cycles: kernel/film/adaptive_sampling.h"),
    ("cluster-thesis", "Lan, Implementation and Optimization of Monte Carlo Ray Tracing, 2016 (docs/THESIS.md)"),
    // Point sets.
    ("sobol", "Sobol' 1967; directions: Joe and Kuo 2008; scrambling: Owen 1997, by hashing: Burley 2020"),
    ("lowdiscrepancy", "Kollig and Keller, Efficient Multidimensional Sampling, 2002, as in pbrt, version 2"),
    ("halton", "Halton, On the Efficiency of Certain Quasi-random Sequences of Points, 1960; scrambling: Owen 1997"),
    ("stratified", "none: one jittered sample per cell, as in textbooks"),
    ("random", "O'Neill, PCG: A Family of Simple Fast Space-Efficient Random Number Generators, 2014"),
    // Filters.
    ("none", "none: the mean of the samples"),
    ("gaussian", "none: a Gaussian over pixels, as in textbooks"),
    ("cluster-gaussian", "Lan, Implementation and Optimization of Monte Carlo Ray Tracing, 2016 (docs/THESIS.md)"),
    ("nlm", "Rousselle, Knaus and Zwicker, Adaptive Rendering with Non-Local Means Filtering, 2012"),
    ("bilateral", "Eisemann and Durand 2004; Petschnigg et al. 2004; with clusters by Dapple"),
    ("cluster-regression", "Dapple, after Moon et al. 2014 and Bitterli et al. 2016 (docs/results/filters.md)"),
    ("oidn", "Intel Open Image Denoise (openimagedenoise.org)"),
    ("both", "Dapple; the mean with Intel Open Image Denoise (docs/results/oidn.md)"),
    // Integrators.
    ("path", "Kajiya, The Rendering Equation, 1986; multiple importance sampling: Veach and Guibas 1995"),
    ("ambient-occlusion", "none: the open share of the hemisphere, as in textbooks"),
];

#[cfg(test)]
mod tests {
    use super::*;
    use dapple_job::registry::{FILTERS, POINTS, SAMPLERS};

    #[test]
    fn every_method_has_a_source_that_the_bibliography_lists() {
        let names = SAMPLERS.iter().map(|entry| entry.name);
        let names = names.chain(POINTS.iter().map(|entry| entry.name)).chain(FILTERS.iter().map(|entry| entry.name));
        let names: Vec<&str> = names.chain(dapple_renderer::integrators().iter().map(|entry| entry.name)).collect();
        assert!(names.iter().all(|name| SOURCES.iter().any(|(known, _)| known == name)), "{names:?}");
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/references.bib");
        let bibliography = std::fs::read_to_string(path).expect("the bibliography");
        for year in
            ["Neyman1934", "Rousselle2012", "Mitchell1987", "pbrtv2", "Cycles", "Lan2016", "Sobol1967", "JoeKuo2008"]
                .into_iter()
                .chain(["Owen1997", "Burley2020", "KolligKeller2002", "Halton1960", "ONeill2014", "EisemannDurand2004"])
                .chain(["Petschnigg2004", "Moon2014", "Bitterli2016", "Kajiya1986", "VeachGuibas1995"])
        {
            assert!(bibliography.contains(&format!("{{{year},")), "{year}");
        }
    }
}
