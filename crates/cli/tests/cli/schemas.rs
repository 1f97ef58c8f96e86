//! The JSON schemas that `dapple schemas` prints, against the JSON that the program prints and writes.

use crate::common::Folder;
use serde_json::{Value, from_str};

/// The faults of a value by a schema: the keywords that our schemas use, and no others.
fn faults(schema: &Value, root: &Value, value: &Value, at: &str) -> Vec<String> {
    let mut found = Vec::new();
    let fail = |what: &str| vec![format!("{at}: {what}: {value}")];
    for (keyword, rule) in schema.as_object().expect("a schema is an object") {
        let number = |limit: &Value| value.as_f64().zip(limit.as_f64());
        let length = value.as_array().map(|items| items.len() as u64).zip(rule.as_u64());
        let is_good = match keyword.as_str() {
            "$schema" | "title" | "description" | "$defs" => true,
            "$ref" => {
                let target = root.pointer(rule.as_str().and_then(|r| r.strip_prefix('#')).expect("a local reference"));
                found.extend(faults(target.expect("a definition"), root, value, at));
                true
            }
            "const" => value == rule,
            "enum" => rule.as_array().expect("values").contains(value),
            "anyOf" => rule.as_array().expect("schemas").iter().any(|s| faults(s, root, value, at).is_empty()),
            "type" => match rule {
                Value::Array(types) => types.iter().any(|t| is_of(value, t)),
                one => is_of(value, one),
            },
            "minimum" => number(rule).is_none_or(|(x, limit)| x >= limit),
            "maximum" => number(rule).is_none_or(|(x, limit)| x <= limit),
            "exclusiveMinimum" => number(rule).is_none_or(|(x, limit)| x > limit),
            "minItems" => length.is_none_or(|(items, limit)| items >= limit),
            "maxItems" => length.is_none_or(|(items, limit)| items <= limit),
            "items" => {
                for (i, item) in value.as_array().into_iter().flatten().enumerate() {
                    found.extend(faults(rule, root, item, &format!("{at}[{i}]")));
                }
                true
            }
            "required" => {
                rule.as_array().expect("names").iter().all(|name| {
                    value.as_object().is_none_or(|fields| fields.contains_key(name.as_str().expect("a name")))
                })
            }
            "properties" => {
                for (name, inner) in rule.as_object().expect("properties") {
                    let field = value.get(name);
                    found.extend(field.map_or(Vec::new(), |field| faults(inner, root, field, &format!("{at}.{name}"))));
                }
                true
            }
            "additionalProperties" => {
                match rule {
                    Value::Bool(false) => value.as_object().into_iter().flatten().all(|(name, _)| {
                        schema.get("properties").is_some_and(|properties| properties.get(name).is_some())
                    }),
                    inner => {
                        let known = |name: &str| schema.get("properties").is_some_and(|p| p.get(name).is_some());
                        let others = value.as_object().into_iter().flatten().filter(|(name, _)| !known(name));
                        others.into_iter().all(|(_, v)| faults(inner, root, v, at).is_empty())
                    }
                }
            }
            other => panic!("the keyword {other} is not checked"),
        };
        if !is_good {
            found.extend(fail(keyword));
        }
    }
    found
}

fn is_of(value: &Value, name: &Value) -> bool {
    match name.as_str().expect("a type") {
        "null" => value.is_null(),
        "boolean" => value.is_boolean(),
        "string" => value.is_string(),
        "array" => value.is_array(),
        "object" => value.is_object(),
        "number" => value.is_number(),
        "integer" => value.as_f64().is_some_and(|x| x.fract() == 0.0),
        other => panic!("no type {other}"),
    }
}

#[test]
fn output_follows_the_schemas() {
    let folder = Folder::new();
    let schema = |name: &str| from_str::<Value>(&folder.done(&format!("schemas {name}"))).expect("a schema");
    let check = |name: &str, json: &str| {
        let (schema, value) = (schema(name), from_str(json).expect("JSON"));
        let found = faults(&schema, &schema, &value, name);
        assert!(found.is_empty(), "{found:#?}");
        // A field too much or too few is a fault: the check is not blind.
        let mut other = value.clone();
        other.as_object_mut().expect("an object").insert("unheard".into(), Value::Null);
        assert!(!faults(&schema, &schema, &other, name).is_empty(), "{name}");
        other = value;
        let first = schema["required"][0].as_str().expect("a required field");
        other.as_object_mut().expect("an object").remove(first);
        assert!(!faults(&schema, &schema, &other, name).is_empty(), "{name} without {first}");
    };
    let shard = "--sampler uniform --light-selection power --filter none";
    for words in
        ["--spp 4 -o a.exr", "--time 0.1 -o a.png", "--error 0.1 --filter none --without interreflection -o b.exr"]
    {
        check("render", &folder.done(&format!("render tiny.pbrt --json {words}")));
    }
    for words in [
        "",
        "--time 3 --crop 0,0,4,4 --resolution 50% --max-depth 3 --max-spp 9 --light-selection uniform",
        "--error 0.1 --error-of unfiltered --resolution 8x8 --without interreflection --pixel-filter box",
    ] {
        check("spec", &folder.done(&format!("render tiny.pbrt --print-spec {words}")));
    }
    check("spec", &folder.done(&format!("render tiny.pbrt --print-spec {shard} --part 1/2")));
    folder.done("render tiny.pbrt --spp 4 --seed 2 -o a.exr");
    folder.done("render tiny.pbrt --spp 4 --seed 3 -o b.exr");
    check("compare", &folder.done("compare a.exr b.exr --json"));
    check("denoise", &folder.done("denoise a.exr b.exr -o c.exr --json"));
    check("effects", &folder.done("effects tiny.pbrt --list --json"));
    check("effects", &folder.done("effects tiny.pbrt --resolution 8x8 --spp 2 --json"));
    folder.done("study --set scenes=tiny.pbrt --set quick=true --set resolution=8x6 --set spp=[1,2] -o study -q");
    check("study", &folder.text("study/study.json"));
    let runs = folder.text("study/runs.jsonl");
    assert!(runs.lines().count() > 8);
    runs.lines().for_each(|run| check("run", run));
    // The list names them all.
    let list = folder.done("schemas");
    for name in ["render", "spec", "compare", "denoise", "effects", "run", "study"] {
        assert!(list.lines().any(|line| line.starts_with(&format!("{name} "))), "{list}");
    }
    assert!(folder.run("schemas rendr").err.contains("there is no schema \"rendr\"; choose among render, spec"));
}
