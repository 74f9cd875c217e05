//! Rendering allocates by the pixel, never by the sample or the ray.

use allocation_counter::{AllocationInfo, measure};
use common::{
    job::JobId,
    method::{Method, Reuse},
    pass::Work,
    protocol::{RenderSettings, Unit, UnitId},
    scene::SceneFile,
    tile::Rect,
};
use serde_json::{Value, json};
use tracer::{Assets, Loaded, Prepared, UnitRender};

const WIDTH: u32 = 24;

fn prepare(shapes: Value, rest: Value) -> Prepared {
    let mut scene = json!({
        "tessera": 1,
        "camera": { "position": [0, 2, 6], "target": [0, 1, 0] },
        "film": { "width": WIDTH, "height": 8 },
        "materials": {
            "glass": { "type": "dielectric" },
            "metal": { "type": "conductor", "metal": "Cu", "roughness": 0.2 }
        },
        "shapes": [
            { "type": "quad", "vertices": [[-4, 0, 4], [4, 0, 4], [4, 0, -4], [-4, 0, -4]] },
            { "type": "sphere", "material": "glass", "center": [1, 1, 1], "radius": 0.7 },
            { "type": "sphere", "material": "metal", "center": [-1, 1, 1], "radius": 0.7 }
        ]
    });
    for shape in shapes.as_array().into_iter().flatten() {
        scene["shapes"].as_array_mut().unwrap().push(shape.clone());
    }
    for (key, value) in rest.as_object().into_iter().flatten() {
        scene[key] = value.clone();
    }
    let scene = SceneFile::parse(scene.to_string().as_bytes()).unwrap();
    Loaded::new(&scene, &Assets::default(), &Method::default(), [WIDTH, 8]).unwrap().build()
}

/// A wavy sheet of 800 triangles.
fn sheet(normals: &str, emission: f64) -> Value {
    let at =
        |i: i32, j: i32| json!([f64::from(i) * 0.1 - 1.0, 2.5 + 0.1 * f64::from(i * j % 3), f64::from(j) * 0.1 - 1.0]);
    let positions: Vec<Value> = (0..21).flat_map(|i| (0..21).map(move |j| at(i, j))).collect();
    let cells = (0..20).flat_map(|i| (0..20).map(move |j| i * 21 + j));
    let triangles: Vec<[i32; 3]> = cells.flat_map(|k| [[k, k + 21, k + 22], [k, k + 22, k + 1]]).collect();
    json!({ "type": "mesh", "positions": positions, "triangles": triangles, "normals": normals, "emission": emission })
}

/// What a row costs at so many samples of a pixel, once room to work in is there.
fn row(prepared: &Prepared, samples: u32, features: bool, reuse: Reuse) -> AllocationInfo {
    let settings = RenderSettings {
        frame: 1,
        resolution: [WIDTH, 8],
        method: Method { reuse, ..Method::default() },
        seed: 1,
        batch: 16,
        batches_per_set: 4,
    };
    let rect = Rect { x: 0, y: 0, w: WIDTH, h: 8 };
    let id = UnitId { job: JobId(1), frame: 1, tile: 0, pass: 0, rect };
    let unit = Unit { id, work: Work::Uniform { first: 0, samples }, features };
    let render = UnitRender::new(prepared, &settings, &unit);
    // Where pixels share paths, all rows are rendered together.
    let (first, second) = if reuse == Reuse::Off { (3, 4) } else { (0, 0) };
    let rays = render.row(first).statistics.rays;
    assert!(rays > u64::from(WIDTH * samples), "something is traced");
    measure(|| drop(render.row(second)))
}

#[test]
fn a_row_allocates_as_much_for_many_samples_as_for_few() {
    let lamp = json!([{ "type": "quad", "vertices": [[-1, 4, -1], [1, 4, -1], [1, 4, 1], [-1, 4, 1]], "emission": 5 }]);
    let sky = json!({ "environment": { "type": "constant", "radiance": 0.5 } });
    for (name, prepared) in [
        ("few primitives", prepare(lamp, json!({}))),
        ("a tree, and a light tree", prepare(json!([sheet("flat", 3.0)]), json!({}))),
        ("a sky", prepare(json!([sheet("flat", 0.0)]), sky.clone())),
        ("one path at a time", prepare(json!([sheet("smooth", 0.0)]), sky)),
    ] {
        for (features, reuse) in [(false, Reuse::Off), (true, Reuse::Off), (false, Reuse::Paths), (true, Reuse::Paths)]
        {
            let (few, many) = (row(&prepared, 16, features, reuse), row(&prepared, 1024, features, reuse));
            let rows = if reuse == Reuse::Off { 1 } else { 8 };
            assert_eq!(few.count_total, many.count_total, "{name}: allocations");
            assert_eq!(few.bytes_total, many.bytes_total, "{name}: bytes");
            assert!(
                many.count_total <= if rows == 1 { 4 } else { 10 },
                "{name}: {} allocations a row",
                many.count_total
            );
            assert!(many.bytes_max < 400 * rows * u64::from(WIDTH), "{name}: {} bytes a row", many.bytes_max);
        }
    }
}
