//! Names of files, made of the names of scenes, methods and budgets.

use crate::{Method, RunBudget};

/// Replaces characters that are unsafe in a file name by `-`, and cuts `name` to 80 characters.
pub(crate) fn safe_file_name(name: &str) -> String {
    let plain = |c: char| if c.is_alphanumeric() || "-_.".contains(c) { c } else { '-' };
    name.chars().map(plain).take(80).collect()
}

/// Unique names of all methods for files, such as `adaptive-cluster-regression`: sampler, point set if methods differ
/// in it, and filter. If two methods would have the same name, the later one gets a number.
pub(crate) fn method_file_names(methods: &[Method]) -> Vec<String> {
    let differ = methods.iter().any(|m| m.points != methods[0].points);
    let mut names: Vec<String> = Vec::new();
    for method in methods {
        let points = differ.then_some(&method.points);
        let parts = [Some(&method.sampler), points, Some(&method.filter)];
        let parts: Vec<&str> = parts.into_iter().flatten().map(String::as_str).collect();
        let name = safe_file_name(&parts.join("-"));
        let numbered = (2..).map(|n| format!("{name}-{n}"));
        let free = std::iter::once(name.clone()).chain(numbered).find(|n| !names.contains(n));
        names.push(free.unwrap_or(name));
    }
    names
}

/// A budget in a file name: `16spp` or `time-of-16spp`.
pub(crate) fn budget_file_name(budget: RunBudget) -> String {
    match budget {
        RunBudget::Spp(n) => format!("{n}spp"),
        RunBudget::TimeOf(n) => format!("time-of-{n}spp"),
    }
}

/// The path of a run's image without extension, relative to the study's folder. `method` is the method's name from
/// [`method_file_names`].
pub(crate) fn image_stem(scene: &str, method: &str, budget: RunBudget) -> String {
    format!("images/{}/{method}-{}", safe_file_name(scene), budget_file_name(budget))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn methods_have_unique_names_for_files() {
        let methods = [
            "adaptive/sobol/cluster-regression",
            "mitchell:mode=budget,radius=2",
            "mitchell:mode=budget/sobol/radius=2",
        ];
        let methods = methods.map(|m| m.parse::<Method>().unwrap());
        let twice = ["a:b".parse().unwrap(), "a-b".parse().unwrap()];
        let names = method_file_names(&methods);
        assert_eq!(names[..2], ["adaptive-cluster-regression", "mitchell-mode-budget-radius-2-none"]);
        assert_eq!(method_file_names(&twice), ["a-b-none", "a-b-none-2"]);
        let points = ["uniform/sobol".parse().unwrap(), "uniform/halton".parse().unwrap()];
        assert_eq!(method_file_names(&points), ["uniform-sobol-none", "uniform-halton-none"]);
        assert_eq!(
            image_stem("a b", &names[0], RunBudget::TimeOf(16)),
            "images/a-b/adaptive-cluster-regression-time-of-16spp"
        );
    }
}
