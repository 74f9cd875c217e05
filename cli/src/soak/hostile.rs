//! Scenes that look for trouble: every family of materials under every kind of light.
//!
//! A scene holds all of a family's extremes at once, on a floor that they touch, before a wall, with slivers,
//! smoothed normals and stretched instances among them; light and camera are put where densities diverge. From one
//! scene to the next size, distance from the origin and camera change, so that every family and every light meets
//! each of those.

use serde_json::{Value, json};

/// Files that the scenes name.
pub const PATTERN: &str = "pattern.png";
const NORMALS: &str = "normals.png";
const SKY: &str = "sky.png";

/// Width and height of every scene's image.
const EDGE: u32 = 16;

/// A scene and what makes it what it is.
pub struct Hostile {
    /// `family--light`, the stem of its file.
    pub name: String,
    /// The scene file.
    pub scene: Value,
}

/// Every scene.
pub fn scenes() -> Vec<Hostile> {
    let mut scenes = Vec::new();
    for (f, (family, materials)) in families().into_iter().enumerate() {
        for (l, (light, lamp)) in LIGHTS.iter().enumerate() {
            let place = PLACES[(f + l) % PLACES.len()];
            let camera = CAMERAS[(f + l / PLACES.len()) % CAMERAS.len()];
            let name = format!("{family}--{light}");
            let scene = scene(&name, &materials, *lamp, camera, place);
            scenes.push(Hostile { name, scene });
        }
    }
    scenes
}

/// The pictures that the scenes name, as 8-bit RGB: name, width, pixels.
pub fn pictures() -> Vec<(&'static str, u32, Vec<[u8; 3]>)> {
    // Black and white beside each other, and channels that disagree.
    let pattern = (0..64u32).map(|i| [0, 8, 16].map(|bit| ((i * 0x9e37 + 0x1234) >> bit) as u8 * (i % 3 != 0) as u8));
    // Flat, leaning, lying, upside down, and no direction at all.
    let tilts = [[128, 128, 255], [255, 128, 128], [128, 0, 140], [128, 128, 0], [0, 0, 0], [255, 255, 255]];
    let normals = (0..64).map(|i| tilts[(i * 7) % tilts.len()]);
    // A sun of one texel in a sky that is black for the most part.
    let sky = (0..128).map(|i| if i == 37 { [255, 250, 240] } else { [u8::from(i % 5 == 0); 3] });
    vec![(PATTERN, 8, pattern.collect()), (NORMALS, 8, normals.collect()), (SKY, 16, sky.collect())]
}

/// Size and place of a scene: lengths are multiplied by `unit`, and `away` units are added to each coordinate.
#[derive(Debug, Clone, Copy)]
struct Place {
    unit: f64,
    away: f64,
}

const PLACES: [Place; 5] = [
    Place { unit: 1.0, away: 0.0 },
    Place { unit: 1e-6, away: 0.0 },
    Place { unit: 1e6, away: 0.0 },
    Place { unit: 1.0, away: 1e4 },
    Place { unit: 1e-3, away: -300.0 },
];

impl Place {
    fn at(self, p: [f64; 3]) -> Value {
        json!(p.map(|c| (c + self.away) * self.unit))
    }

    fn all<const N: usize>(self, points: [[f64; 3]; N]) -> Value {
        points.map(|p| self.at(p)).to_vec().into()
    }

    fn length(self, length: f64) -> f64 {
        length * self.unit
    }

    /// An intensity that lights alike whatever the size.
    fn intensity(self, intensity: f64) -> f64 {
        intensity * self.unit * self.unit
    }
}

type Camera = fn(Place) -> Value;

const CAMERAS: [Camera; 4] = [
    |at| json!({ "position": at.at([0.3, 1.6, 4.0]), "target": at.at([0.0, 0.5, 0.0]), "fov": 60 }),
    // Along the floor.
    |at| json!({ "position": at.at([0.2, 1e-3, 3.0]), "target": at.at([0.0, 1e-3, 0.0]), "fov": 90 }),
    // A lens as wide as what it looks at.
    |at| {
        json!({ "position": at.at([-0.5, 1.0, 3.0]), "target": at.at([0.0, 0.4, 0.0]), "fov": 50,
            "lens_radius": at.length(0.4), "focus_distance": at.length(0.5) })
    },
    |at| {
        json!({ "type": "orthographic", "height": at.length(3.0),
            "position": at.at([1.0, 2.0, 3.0]), "target": at.at([0.0, 0.5, 0.0]) })
    },
];

fn scene(name: &str, variants: &[Value], lamp: Lamp, camera: Camera, at: Place) -> Value {
    let mut materials = serde_json::Map::new();
    for (i, material) in variants.iter().enumerate() {
        materials.insert(format!("m{i}"), material.clone());
    }
    materials.insert("white".into(), json!({ "type": "diffuse", "reflectance": 0.8 }));
    materials.insert("cut".into(), json!({ "type": "diffuse", "opacity": checkerboard(1.0, 0.0) }));
    let m = |i: usize| format!("m{}", i % variants.len());
    let mut shapes = vec![
        json!({ "type": "quad", "material": m(0),
            "vertices": at.all([[-4.0, 0.0, 4.0], [4.0, 0.0, 4.0], [4.0, 0.0, -3.0], [-4.0, 0.0, -3.0]]) }),
        json!({ "type": "quad", "material": "white",
            "vertices": at.all([[-4.0, 0.0, -3.0], [4.0, 0.0, -3.0], [4.0, 4.0, -3.0], [-4.0, 4.0, -3.0]]) }),
    ];
    let count = variants.len();
    for i in 0..count {
        // They touch the floor, and each other.
        let x = 0.5 * (2.0 * i as f64 - (count - 1) as f64);
        shapes.push(
            json!({ "type": "sphere", "material": m(i), "center": at.at([x, 0.5, 0.0]), "radius": at.length(0.5) }),
        );
    }
    let octahedron =
        [[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, -1.0]];
    let faces = json!([[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]]);
    let uvs = json!([[0, 0], [1, 0], [0.5, 1], [0.5, 1], [0, 1], [1, 1]]);
    shapes.push(json!({ "type": "mesh", "normals": "smooth", "material": m(1), "triangles": faces, "uvs": uvs,
        "positions": at.all(octahedron.map(|p| [0.6 * p[0] + 1.2, 0.5 * p[1] + 0.6, 0.5 * p[2] + 1.0])) }));
    // Slivers: nearly without area, nearly without width; and one with no area at all.
    shapes.push(json!({ "type": "mesh", "normals": "smooth", "material": m(2),
        "positions": at.all([[-2.0, 0.2, 0.5], [2.0, 0.2, 0.5], [0.0, 0.2 + 1e-6, 0.5], [-2.0, 1.5, -1.0], [-1.0, 1.5, -1.0],
            [-1.5, 1.5 + 1e-3, -1.0]]),
        "triangles": [[0, 1, 2], [3, 4, 5], [3, 3, 4]] }));
    let object = json!([
        { "type": "mesh", "normals": "smooth", "material": m(3), "triangles": faces,
          "positions": octahedron.map(|p| p.map(|c| json!(at.length(0.4 * c)))).map(|p| json!(p)).to_vec() },
    ]);
    for (i, (x, scale)) in [(-1.5, [1.0, 0.01, 2.0]), (1.8, [0.5, 3.0, -0.5])].into_iter().enumerate() {
        let place = at.at([x, 0.9, -0.8 + i as f64]);
        let transform =
            json!([{ "scale": scale }, { "rotate": { "axis": [1, 2, 3], "degrees": 40 } }, { "translate": place }]);
        shapes.push(json!({ "type": "instance", "object": "thing", "transform": transform }));
    }
    let mut scene = json!({
        "tessera": 1, "name": name, "camera": camera(at), "film": { "width": EDGE, "height": EDGE, "filter": "gaussian" },
        "materials": materials, "objects": { "thing": object }, "shapes": shapes
    });
    lamp(at, &mut scene);
    scene
}

type Lamp = fn(Place, &mut Value);

fn add(scene: &mut Value, list: &str, what: Value) {
    let lists = scene.as_object_mut().map(|scene| scene.entry(list).or_insert_with(|| json!([])));
    if let Some(Value::Array(items)) = lists {
        items.push(what);
    }
}

fn sphere(at: Place, center: [f64; 3], radius: f64, emission: Value) -> Value {
    json!({ "type": "sphere", "center": at.at(center), "radius": at.length(radius), "emission": emission })
}

/// Kinds of light: name, and what puts it into a scene.
const LIGHTS: [(&str, Lamp); 15] = [
    ("rectangle", |at, scene| {
        // Its edge lies in the wall.
        let vertices = at.all([[-1.0, 2.5, -3.0], [1.0, 2.5, -3.0], [1.0, 2.5, -1.0], [-1.0, 2.5, -1.0]]);
        add(scene, "shapes", json!({ "type": "quad", "vertices": vertices, "emission": [8, 6, 4] }));
    }),
    ("quadrilateral", |at, scene| {
        let vertices = at.all([[-1.0, 1.5, 2.0], [1.0, 2.5, 1.0], [2.0, 2.6, 1.4], [0.0, 1.6, 2.4]]);
        let emission = json!({ "radiance": 5, "two_sided": true });
        add(scene, "shapes", json!({ "type": "quad", "vertices": vertices, "emission": emission }));
    }),
    // Standing on the floor, fat and as thin as a hair, and with a triangle far too small to see.
    ("mesh", |at, scene| {
        let positions = at.all([
            [-1.0, 0.0, 1.5],
            [1.0, 0.0, 1.5],
            [0.0, 1.0, 1.2],
            [-2.0, 2.0, 0.0],
            [2.0, 2.0, 0.0],
            [0.0, 2.0 + 1e-5, 0.0],
            [1e-5, 3.0, 0.0],
            [0.0, 3.0, 1e-5],
            [0.0, 3.0, 0.0],
        ]);
        let emission = json!({ "radiance": 20, "two_sided": true });
        add(
            scene,
            "shapes",
            json!({ "type": "mesh", "positions": positions, "normals": "smooth",
            "triangles": [[0, 1, 2], [3, 4, 5], [6, 7, 8]], "emission": emission }),
        );
    }),
    // It touches the floor, where its solid angle is a hemisphere.
    ("sphere", |at, scene| add(scene, "shapes", sphere(at, [0.3, 0.3, 1.4], 0.3, json!([3, 5, 2])))),
    ("tiny-sphere", |at, scene| add(scene, "shapes", sphere(at, [0.1, 2.0, 1.0], 1e-4, json!(1e8)))),
    ("from-inside", |at, scene| {
        let emission = json!({ "radiance": 0.7, "two_sided": true });
        add(scene, "shapes", sphere(at, [0.0, 1.0, 0.0], 30.0, emission));
    }),
    ("disk", |at, scene| {
        let disk = json!({ "type": "disk", "center": at.at([0.5, 1e-4, 1.6]), "normal": [0.1, 1, 0.2],
            "radius": at.length(0.7), "emission": { "radiance": 4, "two_sided": true } });
        add(scene, "shapes", disk);
    }),
    ("cut-out", |at, scene| {
        let vertices = at.all([[-1.0, 2.2, -1.0], [1.0, 2.2, -1.0], [1.0, 2.2, 1.0], [-1.0, 2.2, 1.0]]);
        let emission = json!({ "radiance": { "type": "image", "file": PATTERN, "scale": [50, 20, 10] } });
        add(scene, "shapes", json!({ "type": "quad", "vertices": vertices, "material": "cut", "emission": emission }));
    }),
    // The family's own material shines, on a ball and on stretched copies.
    ("own-material", |at, scene| {
        let mut lamp = sphere(at, [-0.8, 1.4, 0.6], 0.35, json!([2, 3, 4]));
        lamp["material"] = json!("m0");
        add(scene, "shapes", lamp);
        let transform = json!([{ "scale": [1, 0.02, 3] }, { "translate": at.at([0.4, 2.0, 0.2]) }]);
        add(
            scene,
            "shapes",
            json!({ "type": "instance", "object": "thing", "material": "m1", "emission": 6, "transform": transform }),
        );
    }),
    // One in the room, one a hair above the floor.
    ("point", |at, scene| {
        for (p, intensity) in [([0.0, 2.0, 2.0], 10.0), ([0.5, 1e-4, 1.5], 1e-6)] {
            let light = json!({ "type": "point", "position": at.at(p), "intensity": at.intensity(intensity) });
            add(scene, "lights", light);
        }
    }),
    ("spot", |at, scene| {
        for (cutoff, beam) in [(60.0, 60.0), (0.5, 0.0), (180.0, 90.0)] {
            let light = json!({ "type": "spot", "position": at.at([1.0, 3.0, 2.0]), "target": at.at([0.0, 0.4, 0.0]),
                "intensity": at.intensity(20.0), "cutoff_angle": cutoff, "beam_angle": beam });
            add(scene, "lights", light);
        }
    }),
    // From above, and along the floor.
    ("directional", |_, scene| {
        for direction in [[-0.3, -1.0, -0.5], [-1.0, -1e-7, -0.2], [0.0, 0.0, -1.0]] {
            add(scene, "lights", json!({ "type": "directional", "direction": direction, "irradiance": 2 }));
        }
    }),
    ("constant", |_, scene| scene["environment"] = json!({ "type": "constant", "radiance": [0.5, 0.7, 1] })),
    ("sky", |_, scene| {
        let transform = json!([{ "rotate": { "axis": [1, 1, 0], "degrees": 20 } }]);
        scene["environment"] = json!({ "type": "image", "file": SKY, "scale": 1000, "transform": transform });
    }),
    // Powers over twelve decades, sizes over four, and something of each other kind.
    ("many", |at, scene| {
        for i in 0..40i32 {
            let angle = f64::from(i) * 2.4;
            let p = [2.5 * angle.cos(), 0.05 + 0.07 * f64::from(i), 2.0 * angle.sin()];
            let radius = 10f64.powi(-1 - i % 4);
            add(scene, "shapes", sphere(at, p, radius, json!(10f64.powi(i % 13 - 5) / (radius * radius))));
        }
        add(
            scene,
            "lights",
            json!({ "type": "point", "position": at.at([0.0, 3.0, 0.0]), "intensity": at.intensity(4.0) }),
        );
        add(scene, "lights", json!({ "type": "directional", "direction": [0, -1, 0.1], "irradiance": 0.5 }));
        scene["environment"] = json!({ "type": "constant", "radiance": 0.1 });
    }),
];

fn checkerboard(a: f64, b: f64) -> Value {
    json!({ "type": "checkerboard", "color0": a, "color1": b, "uv": { "scale": [5, 3] } })
}

fn image(scale: f64) -> Value {
    json!({ "type": "image", "file": PATTERN, "scale": scale, "wrap": "mirror", "uv": { "scale": [3, 2], "rotate": 30 } })
}

/// The base with one field set to each of `values` in turn.
fn each(base: Value, field: &str, values: &[Value]) -> Vec<Value> {
    let with = |value: &Value| {
        let mut material = base.clone();
        material[field] = value.clone();
        material
    };
    values.iter().map(with).collect()
}

/// GGX alphas: on both sides of the switch to a delta, and up to the roughest, alike and unlike.
fn alphas() -> Vec<Value> {
    [0.00099, 0.001, 0.01, 0.1, 1.0].map(|alpha| json!(alpha)).into_iter().chain([json!([0.001, 1.0])]).collect()
}

/// Families of materials: name and members.
fn families() -> Vec<(&'static str, Vec<Value>)> {
    let exponents = [0.0, 5.0, 1e3, 1e6].map(|exponent| json!(exponent));
    let ior = |ior: f64| json!({ "type": "dielectric", "ior": ior });
    let map = |material: Value, scale: f64| {
        let mut material = material;
        material["normal_map"] = json!({ "file": NORMALS, "scale": scale, "uv": { "scale": [2, 2] } });
        material
    };
    let cut = |material: Value, opacity: Value| {
        let mut material = material;
        material["opacity"] = opacity;
        material
    };
    let lobes = |kind: &str| {
        let mut members = each(json!({ "type": kind, "reflectance": 0.9 }), "exponent", &exponents);
        members.push(json!({ "type": kind, "reflectance": image(1.0), "exponent": 40, "two_sided": false }));
        members
    };
    let rough = |base: Value| each(base, "roughness", &alphas());
    let mut glass = [1.5, 1.0, 1.000_000_1, 0.5, 10.0].map(ior).to_vec();
    glass.push(json!({ "type": "dielectric", "ior": 1.33, "exterior_ior": 2.4, "reflectance": [1, 0, 1], "transmittance": image(1.0) }));
    let mut rough_glass = rough(ior(1.5));
    rough_glass.extend(
        [(1.0, 0.1), (1.0001, 0.01), (0.5, 0.3)]
            .map(|(ior, alpha)| json!({ "type": "dielectric", "ior": ior, "roughness": alpha })),
    );
    let metal = |name: &str| json!({ "type": "conductor", "metal": name });
    let mut metals = ["Au", "Ag", "Cu", "Al", "Cr"].map(metal).to_vec();
    metals.extend(
        [(0.0, 0.0), (1.0, 0.0), (1e-3, 1e3), (1e3, 1e3)]
            .map(|(eta, k)| json!({ "type": "conductor", "eta": eta, "k": k })),
    );
    metals.push(json!({ "type": "conductor", "reflectance": image(1.0) }));
    let mut plastic = rough(json!({ "type": "plastic", "reflectance": 0.9 }));
    plastic.extend([1.0, 1.000_000_1, 0.7, 4.0].map(|ior| json!({ "type": "plastic", "ior": ior, "reflectance": 1 })));
    let mixed = |metallic: Value, roughness: Value| json!({ "type": "metallic_roughness", "base_color": 0.95, "metallic": metallic, "roughness": roughness });
    let mut layered: Vec<Value> =
        [(0.0, 0.0), (1.0, 0.0), (0.5, 0.03), (0.0, 1.0), (1.0, 1.0)].map(|(m, r)| mixed(json!(m), json!(r))).to_vec();
    layered.push(mixed(image(1.0), image(1.0)));
    layered.push(json!({ "type": "metallic_roughness", "ior": 1.0, "metallic": 0, "base_color": image(1.0) }));
    let diffuse = json!({ "type": "diffuse", "reflectance": 0.7 });
    vec![
        ("diffuse", {
            let mut members = each(
                json!({ "type": "diffuse" }),
                "reflectance",
                &[json!(1), json!(0), checkerboard(0.9, 0.1), image(1.0)],
            );
            members.push(json!({ "type": "diffuse", "two_sided": false }));
            members
        }),
        (
            "mirror",
            each(json!({ "type": "mirror" }), "reflectance", &[json!(1), json!(0), json!([1, 0, 0.5]), image(1.0)]),
        ),
        ("glass", glass),
        ("rough-glass", rough_glass),
        ("metal", metals),
        ("rough-metal", rough(metal("Al"))),
        ("plastic", plastic),
        ("phong", lobes("phong")),
        ("blinn-phong", lobes("blinn_phong")),
        ("blinn-microfacet", lobes("blinn_microfacet")),
        ("metallic-roughness", layered),
        (
            "mask",
            vec![
                cut(diffuse.clone(), checkerboard(1.0, 0.0)),
                cut(diffuse.clone(), json!(0.5)),
                cut(ior(1.5), json!(0.3)),
                cut(metal("Cu"), json!(0)),
                cut(json!({ "type": "plastic", "roughness": 0.1 }), image(1.0)),
            ],
        ),
        (
            "normal-map",
            vec![
                map(diffuse.clone(), 1.0),
                map(json!({ "type": "conductor", "metal": "Ag", "roughness": 0.05 }), 1.0),
                map(json!({ "type": "plastic", "roughness": 0.2 }), 10.0),
                map(ior(1.5), 1.0),
                map(json!({ "type": "dielectric", "roughness": 0.1 }), 3.0),
                map(json!({ "type": "mirror", "two_sided": false }), 1.0),
            ],
        ),
    ]
}
