//! The API's description: what the routes say of themselves, with the schemas of the types that serde reads and writes.
//!
//! One derive, schemars', says what a type looks like in JSON, to scene files and here alike.

use common::{
    hash::AssetHash,
    job::{JobId, JobRequest, LeaseId, WorkerId},
    protocol::{
        API, AttemptList, Convergence, ErrorBody, FailureList, FarmView, Heartbeat, HeartbeatReply, JobList, JobPatch,
        JobView, Lease, LeaseFailure, LeaseRequest, Register, Registered, ShippedScenes, Stored, TileList, UnitId,
        WorkerList, WorkerView,
    },
};
use schemars::{JsonSchema, Schema, SchemaGenerator, generate::SchemaSettings, transform::RecursiveTransform};
use serde_json::{Map, Value, json};
use utoipa::openapi::OpenApi;

use crate::{assemble::Picture, service::Receipt};

/// The whole document, from the routes under the prefix and those without.
pub(super) fn document(api: OpenApi, plain: OpenApi) -> Value {
    let mut paths = Map::new();
    for (prefix, part) in [(API, api), ("", plain)] {
        let Ok(Value::Object(found)) = serde_json::to_value(part.paths.paths) else { continue };
        paths.extend(found.into_iter().map(|(path, item)| (format!("{prefix}{path}"), item)));
    }
    for (path, item) in &mut paths {
        let Value::Object(operations) = item else { continue };
        for (method, operation) in operations {
            complete(path, method, operation);
        }
    }
    json!({
        "openapi": "3.1.0",
        "info": {
            "title": "Tessera",
            "version": env!("CARGO_PKG_VERSION"),
            "description": "The REST interface of a Tessera coordinator. Every answer that is not a success has the one \
                error body. GET answers have an ETag and know If-None-Match. Every answer has an X-Request-Id, the \
                client's own where it sent one; the logs carry it, up to the worker's. Where the coordinator has a \
                token, every call under /api/v1 needs it: Authorization: Bearer TOKEN.",
            "license": { "name": "MIT OR Apache-2.0" },
        },
        "servers": [{ "url": "/" }],
        "tags": [
            { "name": "jobs", "description": "Submit, look at, change." },
            { "name": "frames", "description": "Pictures and tiles." },
            { "name": "assets", "description": "Files, named by their BLAKE3 hash." },
            { "name": "workers", "description": "Machines that render." },
            { "name": "farm", "description": "The farm as a whole." },
            { "name": "worker side", "description": "What workers say; people have no use for it." },
            { "name": "service", "description": "Liveness, readiness, figures." },
        ],
        "paths": paths,
        "components": {
            "schemas": schemas(),
            "securitySchemes": { "token": { "type": "http", "scheme": "bearer" } },
        },
        "security": [{}, { "token": [] }],
    })
}

/// Add to an operation what all have in common: a name of its own, the parameters of its path, and the error body.
fn complete(path: &str, method: &str, operation: &mut Value) {
    let Value::Object(operation) = operation else { return };
    let words = path.trim_start_matches(API).replace(['{', '}'], "").replace(['/', '.'], "_");
    operation.insert("operationId".into(), json!(format!("{method}{words}")));
    let parameters = operation.entry("parameters").or_insert_with(|| json!([]));
    if let Value::Array(parameters) = parameters {
        for parameter in parameters.iter_mut() {
            // Absent is not null.
            if let Some(kinds) = parameter.pointer_mut("/schema/type").filter(|kinds| kinds.is_array()) {
                *kinds = json!("string");
            }
            // Routes read numbers without a sign.
            if let Some(schema) = parameter["schema"].as_object_mut()
                && schema.get("format").is_some_and(|format| format == "int32")
            {
                schema.remove("format");
                schema.entry("maximum").or_insert(json!(u32::MAX));
            }
            if parameter["name"] == "map" {
                parameter["schema"] = json!({ "type": "string", "enum": ["image", "samples", "error"] });
            }
            if parameter["name"] == "cursor" && path.ends_with("/attempts") {
                parameter["schema"] = json!({ "type": "string", "pattern": "^([0-9]{1,19})?$" });
                continue;
            }
            let reference = match parameter["name"].as_str() {
                Some("status") => "JobState",
                Some("outcome") => "Outcome",
                Some("cursor") => "JobId",
                _ => continue,
            };
            // An empty one counts as absent.
            let named = json!({ "$ref": format!("#/components/schemas/{reference}") });
            parameter["schema"] = json!({ "anyOf": [named, { "const": "" }] });
        }
        for name in path.split('{').skip(1).filter_map(|rest| rest.split('}').next()) {
            let schema = parameter(path, name);
            parameters.push(json!({ "name": name, "in": "path", "required": true, "schema": schema }));
        }
    }
    if let Some(Value::Object(body)) = operation.get_mut("requestBody") {
        // An empty file is a file.
        body.insert("required".into(), json!(!path.ends_with("/assets")));
    }
    if let Some(Value::Object(responses)) = operation.get_mut("responses") {
        responses.entry("default").or_insert_with(|| {
            json!({
                "description": "It was refused, or failed.",
                "content": { "application/json": { "schema": { "$ref": "#/components/schemas/ErrorBody" } } },
            })
        });
    }
}

/// What a part of a path looks like.
fn parameter(path: &str, name: &str) -> Value {
    let reference = |name: &str| json!({ "$ref": format!("#/components/schemas/{name}") });
    match name {
        "id" if path.contains("/workers/") => reference("WorkerId"),
        "id" => reference("JobId"),
        "lease" => reference("LeaseId"),
        "unit" => reference("UnitId"),
        "hash" => reference("AssetHash"),
        "frame" => json!({ "type": "integer", "minimum": 0, "maximum": u32::MAX }),
        "picture" => json!({ "type": "string", "enum": Picture::ALL.map(Picture::name) }),
        "chart" => json!({ "type": "string", "enum": ["queue.svg", "throughput.svg", "busy.svg"] }),
        _ => json!({ "type": "string" }),
    }
}

fn schemas() -> Map<String, Value> {
    let settings = SchemaSettings::draft2020_12().with(|settings| {
        settings.definitions_path = "/components/schemas".into();
        settings.transforms.push(Box::new(RecursiveTransform(|schema: &mut Schema| {
            // A format is a remark; a bound is a rule.
            let most = match schema.get("format").and_then(Value::as_str) {
                Some("uint32") => json!(u32::MAX),
                Some("uint64") => json!(u64::MAX),
                _ => return,
            };
            schema.ensure_object().entry("maximum").or_insert(most);
        })));
    });
    let mut generator = settings.into_generator();
    fn add<T: JsonSchema>(generator: &mut SchemaGenerator) {
        generator.subschema_for::<T>();
    }
    add::<ErrorBody>(&mut generator);
    add::<JobRequest>(&mut generator);
    add::<JobPatch>(&mut generator);
    add::<JobView>(&mut generator);
    add::<JobList>(&mut generator);
    add::<FailureList>(&mut generator);
    add::<AttemptList>(&mut generator);
    add::<Convergence>(&mut generator);
    add::<TileList>(&mut generator);
    add::<FarmView>(&mut generator);
    add::<ShippedScenes>(&mut generator);
    add::<Stored>(&mut generator);
    add::<WorkerList>(&mut generator);
    add::<WorkerView>(&mut generator);
    add::<Register>(&mut generator);
    add::<Registered>(&mut generator);
    add::<LeaseRequest>(&mut generator);
    add::<Lease>(&mut generator);
    add::<Heartbeat>(&mut generator);
    add::<HeartbeatReply>(&mut generator);
    add::<LeaseFailure>(&mut generator);
    add::<Receipt>(&mut generator);
    add::<AssetHash>(&mut generator);
    add::<JobId>(&mut generator);
    add::<WorkerId>(&mut generator);
    add::<LeaseId>(&mut generator);
    add::<UnitId>(&mut generator);
    generator.take_definitions(true)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every `$ref` in a value.
    fn references(value: &Value, found: &mut Vec<String>) {
        match value {
            Value::Object(map) => {
                found.extend(map.get("$ref").and_then(Value::as_str).map(str::to_owned));
                map.values().for_each(|value| references(value, found));
            }
            Value::Array(list) => list.iter().for_each(|value| references(value, found)),
            _ => {}
        }
    }

    #[test]
    fn every_reference_leads_somewhere() {
        let document = crate::http::openapi();
        let mut found = Vec::new();
        references(&document, &mut found);
        assert!(found.len() > 50);
        for reference in found {
            let pointer = reference.strip_prefix('#').unwrap();
            assert!(document.pointer(pointer).is_some(), "{reference}");
        }
    }

    /// `cargo run --release -p tessera-coordinator --example openapi > docs/openapi.json` writes it anew.
    #[test]
    fn the_description_is_the_one_that_is_kept() {
        let kept = include_str!("../../../docs/openapi.json");
        let kept: Value = serde_json::from_str(kept).unwrap();
        let made = crate::http::openapi();
        assert!(
            made == kept,
            "docs/openapi.json is out of date: write it anew by the example `openapi`, and look at what changed"
        );
    }
}
