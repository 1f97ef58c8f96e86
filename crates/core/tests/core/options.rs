//! Options of integrators, samplers and filters as text.

use dapple_core::options::{Options as _, nearest_name, nested, unnested};

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Shape {
    Round,
    Square,
}

#[test]
fn nearest_names() {
    assert_eq!(nearest_name("FOB", ["radius", "fov"]), Some("fov"));
    assert_eq!(nearest_name("zzz", ["radius", "fov"]), None);
}

dapple_core::choices!(Shape { Round = "round", Square = "square" });

dapple_core::options! {
    /// Options of a test.
    struct TestOptions {
        /// A count.
        ///
        /// More about it.
        pub count: u32 = 3, |count| count < 10, "below 10";
        /// A shape.
        pub shape: Shape = Shape::Round => "round";
        /// A weight, or none.
        pub weight: Option<f32> = None => "none", |weight| weight.is_none_or(|w| w > 0.0), "above 0, or none";
    }
}

#[test]
fn a_declaration_makes_defaults_table_and_description() {
    let names: Vec<_> = TestOptions::PARAMETERS.iter().map(|p| (p.name, p.default, p.help)).collect();
    assert_eq!(
        names,
        [("count", "3", "A count."), ("shape", "round", "A shape."), ("weight", "none", "A weight, or none.")]
    );
    assert_eq!(TestOptions::default().describe(), "count=3,shape=round,weight=none");
    let all = TestOptions::default().count(9).shape(Shape::Square).weight(Some(0.5));
    assert_eq!(TestOptions::parse(&all.describe()), Ok(all));
    assert_eq!(TestOptions::parse(" count = 9 ,, weight=0.5,shape=square"), Ok(all), "blanks do no harm");
}

#[test]
fn wrong_text_is_refused_with_the_nearest_name_and_the_range() {
    let refused = |text: &str| TestOptions::parse(text).unwrap_err().to_string();
    assert_eq!(
        refused("cuont=3"),
        "there is no parameter \"cuont\"; did you mean \"count\"? Known parameters: count, shape, weight"
    );
    assert_eq!(refused("zzzzzz=3"), "there is no parameter \"zzzzzz\"; known parameters: count, shape, weight");
    assert_eq!(refused("count"), "\"count\" is not of the form key=value; give each parameter a value");
    assert_eq!(refused("count=1,count=2"), "parameter \"count\" is given twice; remove one");
    assert_eq!(refused("count=many"), "count = \"many\" is not valid; use a number (below 10)");
    assert_eq!(refused("count=10"), "count = 10 is out of range; allowed: below 10");
    assert_eq!(refused("shape=oval"), "shape = \"oval\" is not valid; use one of round, square");
    assert_eq!(refused("weight=NaN"), "weight = NaN is out of range; allowed: above 0, or none");
    assert_eq!(TestOptions::default().set("other", "1"), Ok(false));
}

#[test]
fn descriptions_of_any_depth_are_read_back() {
    let mut description = "uniform".to_owned();
    for depth in 0..6 {
        let value = nested(&description);
        assert!(!value.contains([':', ',']), "{value} cannot be the value of a parameter");
        assert_eq!(unnested(&value), description, "depth {depth}");
        description = format!("sequence:first={value},spp={depth},second=adaptive/by=nlm/pilot=4");
    }
}

#[test]
fn only_the_first_separator_follows_a_name() {
    assert_eq!(unnested("a/b=1/c=2/d=3"), "a:b=1,c=2,d=3");
    assert_eq!(unnested("a"), "a");
    assert_eq!(unnested("a/of=b//c=1//d=2/e=3"), "a:of=b/c=1/d=2,e=3");
    assert_eq!((unnested(""), unnested("/"), nested("")), (String::new(), ":".into(), String::new()));
}
