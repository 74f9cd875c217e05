//! The reference pages, written from what they describe: the command line, the schema of scene files, the API.

use clap::{Arg, Command, CommandFactory};
use serde_json::Value;

use crate::{args::Cli, examples};

/// How to make the pages again; stands at the top of each.
const MADE: &str =
    "<!-- Written by `UPDATE_DOCS=1 cargo test --release -p tessera-tests --test docs`. Do not edit. -->";

/// Every command by its words, in the order of the help: `scene check`.
#[must_use]
pub fn names() -> Vec<String> {
    fn walk(command: &Command, words: &str, found: &mut Vec<String>) {
        for inner in command.get_subcommands().filter(|inner| inner.get_name() != "help") {
            let words = format!("{words} {}", inner.get_name());
            match inner.has_subcommands() {
                true => walk(inner, &words, found),
                false => found.push(words.trim().to_owned()),
            }
        }
    }
    let mut found = Vec::new();
    walk(&Cli::command(), "", &mut found);
    found
}

/// docs/reference/cli.md: every command with its options.
#[must_use]
pub fn commands() -> String {
    let mut command = examples::shown(Cli::command()).term_width(100);
    command.build();
    let mut out = format!(
        "# Commands\n\n{MADE}\n\nExit codes: 0 done, 1 the work, the network or a port failed, 2 the input was wrong, 130 \
         interrupted. An error is one sentence on standard error. Results go to standard output, as JSON where there is \
         `--json`; progress goes to standard error, as a bar on a terminal and as a line every few seconds elsewhere.\n"
    );
    let mut everywhere: Vec<&Arg> = command.get_arguments().filter(|arg| arg.is_global_set()).collect();
    everywhere.sort_by_key(|arg| arg.get_id().to_string());
    out += "\n## Options of every command\n\n";
    out += &options(&everywhere);
    walk(&command, "tessera", &mut out);
    out
}

fn walk(command: &Command, path: &str, out: &mut String) {
    for inner in command.get_subcommands().filter(|inner| inner.get_name() != "help") {
        let path = format!("{path} {}", inner.get_name());
        if inner.get_subcommands().next().is_some() {
            walk(inner, &path, out);
            continue;
        }
        *out += &format!("\n## {path}\n\n{}.\n", text(inner.get_about()));
        if let Some(examples) = inner.get_after_help() {
            let lines: Vec<String> =
                examples.to_string().lines().skip(1).map(|line| format!("    {}", line.trim_start())).collect();
            *out += &format!("\n{}\n", lines.join("\n"));
        }
        let own = |arg: &&Arg| !arg.is_global_set() && !["help", "version"].contains(&arg.get_id().as_str());
        let all: Vec<&Arg> = inner.get_arguments().filter(own).collect();
        if !all.is_empty() {
            *out += &format!("\n{}", options(&all));
        }
    }
}

fn text(styled: Option<&clap::builder::StyledStr>) -> String {
    styled.map(ToString::to_string).unwrap_or_default().replace('\n', " ")
}

fn options(all: &[&Arg]) -> String {
    let mut out = "| Option | Does | Default, variable |\n| --- | --- | --- |\n".to_string();
    for arg in all {
        let values = arg.get_value_names().unwrap_or_default().iter().map(ToString::to_string);
        let values = if arg.get_action().takes_values() { values.collect::<Vec<_>>().join(" ") } else { String::new() };
        let name = match (arg.get_short(), arg.get_long()) {
            (Some(short), Some(long)) => format!("-{short}, --{long} {values}"),
            (None, Some(long)) => format!("--{long} {values}"),
            _ => values,
        };
        let choices: Vec<String> =
            arg.get_possible_values().iter().map(|value| format!("`{}`", value.get_name())).collect();
        let choices = if choices.is_empty() || !arg.get_action().takes_values() {
            String::new()
        } else {
            format!(": {}", choices.join(", "))
        };
        let defaults = if arg.get_action().takes_values() { arg.get_default_values() } else { &[] };
        let default = defaults.iter().map(|value| format!("`{}`", value.to_string_lossy()));
        let variable = arg.get_env().map(|name| format!("`{}`", name.to_string_lossy()));
        let last: Vec<String> = default.chain(variable).collect();
        let does = text(arg.get_help());
        out += &format!("| `{}` | {}{choices} | {} |\n", name.trim(), cell(&does), last.join(", "));
    }
    out
}

fn cell(text: &str) -> String {
    text.replace('|', "\\|")
}

/// docs/reference/scene.md: every object of a scene file with its fields.
#[must_use]
pub fn scene() -> String {
    let schema = schemars::schema_for!(common::scene::SceneFile).to_value();
    let mut out = format!(
        "# Scene files\n\n{MADE}\n\nA scene is a JSON file with `\"tessera\": 1`. Lengths are in scene units, angles in degrees, \
         colours linear with Rec. 709 primaries, radiance in W/(m^2 sr) per channel. Unknown fields are refused, and every \
         error names its place in the file. `tessera scene schema` prints the JSON Schema that this page is made of; \
         `tessera scene check FILE` reads a scene with all its files. For whole scenes see [scenes](../../scenes).\n"
    );
    object("Scene", &schema, &mut out);
    if let Some(parts) = schema["$defs"].as_object() {
        for (name, part) in parts.iter().filter(|(name, _)| !["Frames", "AssetHash"].contains(&name.as_str())) {
            object(name, part, &mut out);
        }
    }
    out
}

/// docs/reference/api.md: every route with what it takes and answers, and the types of both.
#[must_use]
pub fn api() -> String {
    let document = coordinator::http::openapi();
    let none = serde_json::Map::new();
    let map = |pointer: &str| document.pointer(pointer).and_then(Value::as_object).unwrap_or(&none);
    let mut out = format!(
        "# API\n\n{MADE}\n\n{} The same as OpenAPI: `/api/v1/openapi.json` of a coordinator, kept as \
         [openapi.json](../openapi.json), and to be browsed at `/docs`. Whole programs: [examples](../examples).\n",
        text_of(&document["info"]["description"])
    );
    for group in document["tags"].as_array().into_iter().flatten() {
        out += &format!("\n## {}\n\n{}\n", capital(text_of(&group["name"])), text_of(&group["description"]));
        for (path, item) in map("/paths") {
            let operations = item.as_object().into_iter().flatten();
            for (method, operation) in operations.filter(|(_, operation)| operation["tags"][0] == group["name"]) {
                route(method, path, operation, &mut out);
            }
        }
    }
    out += "\n## Types\n\nScenes, and what they hold, are described in [scene files](scene.md).\n";
    // What scene files hold too has its place there.
    let scene = schemars::schema_for!(common::scene::SceneFile).to_value();
    let of_scenes = |name: &str| name == "SceneFile" || scene["$defs"].get(name).is_some();
    for (name, schema) in map("/components/schemas").iter().filter(|(name, _)| !of_scenes(name)) {
        let mut part = String::new();
        object(name, schema, &mut part);
        out += &part.replace("\n## ", "\n### ").replace(&format!("\n### {name}: "), &format!("\n#### {name}: "));
    }
    for name in map("/components/schemas").keys().filter(|name| of_scenes(name)) {
        let place = if name == "SceneFile" { "scene".into() } else { name.to_lowercase() };
        out = out.replace(&format!("](#{})", name.to_lowercase()), &format!("](scene.md#{place})"));
    }
    out
}

fn route(method: &str, path: &str, operation: &Value, out: &mut String) {
    *out += &format!("\n### {} {path}\n\n{}.", method.to_uppercase(), text_of(&operation["summary"]));
    if let Some(more) = operation["description"].as_str() {
        *out += &format!(" {}", more.replace('\n', " "));
    }
    *out += "\n";
    let body = |holder: &Value| {
        let content = holder["content"].as_object()?.iter().next()?;
        Some(if content.0 == "application/json" { kind(&content.1["schema"]) } else { format!("`{}`", content.0) })
    };
    let taken = operation["parameters"].as_array().into_iter().flatten().map(|parameter| {
        let (name, place) = (text_of(&parameter["name"]), text_of(&parameter["in"]));
        (format!("`{name}`, {place}"), kind(&parameter["schema"]), text_of(&parameter["description"]).to_owned())
    });
    let taken = taken.chain(
        operation
            .get("requestBody")
            .and_then(|given| Some(("body".into(), body(given)?, text_of(&given["description"]).to_owned()))),
    );
    let taken: Vec<String> =
        taken.map(|(what, is, means)| format!("| {what} | {} | {} |\n", cell(&is), cell(&means))).collect();
    if !taken.is_empty() {
        *out += &format!("\n| Takes | Is | Means |\n| --- | --- | --- |\n{}", taken.concat());
    }
    *out += "\n| Answers | With | When |\n| --- | --- | --- |\n";
    for (status, answer) in operation["responses"].as_object().into_iter().flatten() {
        let status = if status == "default" { "else" } else { status };
        let with = body(answer).unwrap_or_default();
        *out += &format!("| {status} | {} | {} |\n", cell(&with), cell(text_of(&answer["description"])));
    }
}

fn text_of(value: &Value) -> &str {
    value.as_str().unwrap_or_default()
}

fn capital(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or(String::new(), |first| first.to_uppercase().chain(letters).collect())
}

fn object(name: &str, schema: &Value, out: &mut String) {
    *out += &format!("\n## {name}\n\n{}\n", sentence(schema));
    fields(schema, out);
    if let Some(pattern) = schema["pattern"].as_str() {
        *out += &format!("\nA string: `{pattern}`\n");
    }
    if let Some(names) = schema["enum"].as_array() {
        *out += &format!("\nOne of {}.\n", names.iter().map(|name| format!("`{name}`")).collect::<Vec<_>>().join(", "));
    }
    let variants: Vec<&Value> = ["oneOf", "anyOf"].iter().filter_map(|key| schema[*key].as_array()).flatten().collect();
    for variant in variants {
        match tag(variant) {
            Some((field, value)) => {
                *out += &format!("\n### {name}: `\"{field}\": \"{value}\"`\n\n{}\n", sentence(variant));
                fields(variant, out);
            }
            None if variant["const"].is_string() => {
                *out += &format!("\n- `{}`: {}", variant["const"], sentence(variant));
            }
            None if variant["properties"].is_object() => {
                *out += "\nWith the fields:\n";
                fields(variant, out);
            }
            None => *out += &format!("\n- or {}", kind(variant)),
        }
    }
    *out = format!("{}\n", out.trim_end());
}

/// The field that tells variants apart, and its value.
fn tag(variant: &Value) -> Option<(&str, &str)> {
    let mut properties = variant["properties"].as_object()?.iter();
    properties.find_map(|(name, value)| Some((name.as_str(), value["const"].as_str()?)))
}

fn fields(schema: &Value, out: &mut String) {
    let Some(properties) = schema["properties"].as_object() else { return };
    let required = |name: &str| schema["required"].as_array().is_some_and(|all| all.iter().any(|one| one == name));
    let shown: Vec<_> = properties.iter().filter(|(_, value)| value["const"].is_null()).collect();
    if shown.is_empty() {
        return;
    }
    *out += "\n| Field | Is | Default | Means |\n| --- | --- | --- | --- |\n";
    for (name, value) in shown {
        let default = match &value["default"] {
            _ if required(name) => "required".into(),
            Value::Null => String::new(),
            default => format!("`{default}`"),
        };
        *out += &format!("| `{name}` | {} | {default} | {} |\n", cell(&kind(value)), cell(&sentence(value)));
    }
}

fn sentence(schema: &Value) -> String {
    schema["description"].as_str().unwrap_or_default().replace('\n', " ")
}

/// What a value is, in words.
fn kind(schema: &Value) -> String {
    if let Some(name) = schema["$ref"].as_str().and_then(|path| path.rsplit('/').next()) {
        return match name {
            "Frames" => "a list of frames such as `\"1-10\"`".into(),
            "AssetHash" => "a BLAKE3 hash".into(),
            _ => format!("[{name}](#{})", name.to_lowercase()),
        };
    }
    if let Some(all) = schema["anyOf"].as_array().or(schema["allOf"].as_array()) {
        let kinds: Vec<String> = all.iter().filter(|one| one["type"] != "null").map(kind).collect();
        return kinds.join(" or ");
    }
    let types: Vec<&str> = match &schema["type"] {
        Value::String(name) => vec![name],
        Value::Array(names) => names.iter().filter_map(Value::as_str).filter(|name| *name != "null").collect(),
        _ => vec![],
    };
    match types[..] {
        ["array"] => {
            let of = kind(&schema["items"]);
            match schema["minItems"].as_u64().filter(|n| schema["maxItems"] == *n) {
                Some(n) => format!("{n} of {of}"),
                None => format!("list of {of}"),
            }
        }
        ["object"] => match &schema["additionalProperties"] {
            inner @ Value::Object(_) => format!("by name: {}", kind(inner)),
            _ => "object".into(),
        },
        [name] => format!("{name}{}", range(schema)),
        _ => match schema["const"].as_str() {
            Some(value) => format!("`\"{value}\"`"),
            None => "value".into(),
        },
    }
}

/// The bounds of a number, and the values of a text, where there are any.
fn range(schema: &Value) -> String {
    if let Some(values) = schema["enum"].as_array() {
        return format!(": {}", values.iter().map(|value| format!("`{value}`")).collect::<Vec<_>>().join(", "));
    }
    let bound = |key: &str| schema[key].as_number();
    // What every number of its kind keeps to is no news.
    let most = bound("maximum").filter(|n| ![u64::from(u32::MAX), u64::MAX].iter().any(|m| n.as_u64() == Some(*m)));
    let least = bound("minimum").filter(|n| n.as_f64() != Some(0.0) || most.is_some());
    match (least, most, bound("exclusiveMinimum"), bound("exclusiveMaximum")) {
        (Some(least), Some(most), ..) => format!(", {least} to {most}"),
        (Some(least), None, ..) => format!(", at least {least}"),
        (None, Some(most), ..) => format!(", at most {most}"),
        (_, _, Some(least), Some(most)) => format!(" between {least} and {most}"),
        (_, _, Some(least), None) => format!(" above {least}"),
        _ => String::new(),
    }
}
