//! The same scene at another size, or elsewhere, is the same picture: no length is built in.
//!
//! A factor that is a power of two changes no digit of any number, so nothing of the image may change either, to the
//! bit. Other factors and places round the scene itself; what that may do is stated at each test.

use common::{
    film::Moments,
    method::{Direct, LightPick, LightSampling, MethodChoices},
    scene::SceneFile,
};
use serde_json::{Value, json};
use tessera_tests::direct::render;

/// Samples of a pixel.
const SAMPLES: u32 = 64;

/// Lengths are multiplied by `factor`, then everything is moved by `place` along x, -0.5 of it along y, and 0.25
/// along z.
#[derive(Debug, Clone, Copy)]
struct Map {
    factor: f64,
    place: f64,
}

impl Map {
    fn at(self, p: [f64; 3]) -> Value {
        let along = [1.0, -0.5, 0.25];
        json!([0, 1, 2].map(|i| p[i] * self.factor + self.place * along[i]))
    }

    fn all<const N: usize>(self, points: [[f64; 3]; N]) -> Value {
        points.map(|p| self.at(p)).to_vec().into()
    }

    fn length(self, length: f64) -> f64 {
        length * self.factor
    }
}

/// An open room about 100 wide with what can go wrong in it: glass, rough and smooth metal, a coat, smoothed normals,
/// a thin lens, a narrow gap; a rectangle, a mesh, a ball, a disk, a point and the surroundings for light. All
/// coordinates are multiples of 1/8 and none of the planes passes through the origin.
fn scene(map: Map) -> SceneFile {
    let quad = |material: &str, points: [[f64; 3]; 4]| json!({ "type": "quad", "material": material, "vertices": map.all(points) });
    let ball = |material: &str, center: [f64; 3], radius: f64| json!({ "type": "sphere", "material": material, "center": map.at(center), "radius": map.length(radius) });
    let lamp = |mut shape: Value, emission: Value| {
        shape["emission"] = emission;
        shape
    };
    let octahedron =
        [[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, -1.0]];
    let faces = json!([[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]]);
    let body =
        |center: [f64; 3], radius: f64| map.all(octahedron.map(|p| [0, 1, 2].map(|i| center[i] + radius * p[i])));
    let scene = json!({
        "tessera": 1, "film": { "width": 32, "height": 24 },
        "camera": { "position": map.at([3.0, 15.0, 120.0]), "target": map.at([1.0, -5.0, -10.0]), "fov": 50,
            "lens_radius": map.length(0.5), "focus_distance": map.length(125.0) },
        "materials": {
            "white": { "type": "diffuse", "reflectance": 0.7 },
            "red": { "type": "diffuse", "reflectance": [0.6, 0.1, 0.1] },
            "glass": { "type": "dielectric" },
            "frosted": { "type": "dielectric", "roughness": 0.2 },
            "gold": { "type": "conductor", "metal": "Au", "roughness": 0.15 },
            "mirror": { "type": "mirror", "reflectance": 0.9 },
            "plastic": { "type": "plastic", "reflectance": [0.1, 0.3, 0.6], "roughness": 0.1 }
        },
        "shapes": [
            quad("white", [[-60.0, -30.0, 60.0], [60.0, -30.0, 60.0], [60.0, -30.0, -50.0], [-60.0, -30.0, -50.0]]),
            // A gap of an eighth.
            quad("plastic", [[-20.0, -29.875, 40.0], [25.0, -29.875, 40.0], [25.0, -29.875, 10.0], [-20.0, -29.875, 10.0]]),
            quad("white", [[-60.0, -30.0, -50.0], [60.0, -30.0, -50.0], [60.0, 45.0, -50.0], [-60.0, 45.0, -50.0]]),
            quad("red", [[-60.0, -30.0, 60.0], [-60.0, -30.0, -50.0], [-60.0, 45.0, -50.0], [-60.0, 45.0, 60.0]]),
            ball("glass", [-28.0, -14.0, 10.0], 15.0),
            ball("gold", [25.0, -17.0, -20.0], 13.0),
            ball("mirror", [-5.0, -20.0, -30.0], 10.0),
            json!({ "type": "mesh", "normals": "smooth", "material": "frosted", "triangles": faces, "positions": body([40.0, -15.0, 20.0], 12.0) }),
            lamp(quad("white", [[-15.0, 44.0, -15.0], [15.0, 44.0, -15.0], [15.0, 44.0, 15.0], [-15.0, 44.0, 15.0]]), json!([9, 8, 6])),
            lamp(ball("white", [45.0, 5.0, -35.0], 4.0), json!([4, 8, 20])),
            lamp(json!({ "type": "mesh", "triangles": faces, "positions": body([-45.0, 10.0, -30.0], 3.0) }), json!(20)),
            lamp(json!({ "type": "disk", "center": map.at([2.0, -20.0, 45.0]), "normal": [0.2, -1, 0.1], "radius": map.length(2.5) }),
                json!({ "radiance": 10, "two_sided": true })),
        ],
        "lights": [{ "type": "point", "position": map.at([-30.0, 30.0, 40.0]), "intensity": 500.0 * map.factor * map.factor }],
        "environment": { "type": "constant", "radiance": [0.1, 0.15, 0.2] }
    });
    SceneFile::parse(scene.to_string().as_bytes()).unwrap_or_else(|error| panic!("{map:?}: {error}"))
}

fn image(map: Map, choices: MethodChoices) -> Vec<Moments> {
    let picture = render("inline.json", &scene(map), SAMPLES, choices);
    assert_eq!(picture.rejected, 0, "{map:?}");
    picture.moments
}

/// Compare with the image of the same scene at home: means within `bound`, relative, and 4 standard errors of their
/// difference, since a path that rounding turns aside may be one in ten thousand that is bright; pixels within 5 of their standard
/// errors and a percent; and squared differences below `share` of what two independent images would have, since the
/// same numbers were drawn for both.
fn check(home: &[Moments], there: &[Moments], bound: f64, share: f64, what: &str) {
    let mean = |image: &[Moments]| image.iter().map(|pixel| pixel.luminance()).sum::<f64>() / image.len() as f64;
    let variance = |a: &Moments, b: &Moments| a.variance_of_mean().unwrap() + b.variance_of_mean().unwrap();
    let (here, away) = (mean(home), mean(there));
    assert!(here > 0.1, "{what}: the room is dark");
    let (mut squares, mut noise) = (0.0, 0.0);
    for (i, (a, b)) in home.iter().zip(there).enumerate() {
        let (off, variance) = ((a.luminance() - b.luminance()).abs(), variance(a, b));
        let allowed = 5.0 * variance.sqrt() + 0.01 * a.luminance();
        assert!(off <= allowed, "{what}: pixel {i} is {}, at home {}", b.luminance(), a.luminance());
        squares += off * off;
        noise += variance;
    }
    let chance = squares.sqrt() / home.len() as f64;
    let allowed = bound * here + 4.0 * chance;
    assert!((away - here).abs() <= allowed, "{what}: the mean is {away}, at home {here}, by chance {chance}");
    println!("{what}: mean off by {:.1e}, differences {:.1e} of the noise", away / here - 1.0, squares / noise);
    assert!(squares <= share * noise, "{what}: differences are {} of the noise", squares / noise);
}

const HOME: Map = Map { factor: 1.0, place: 0.0 };

#[test]
fn a_power_of_two_changes_no_bit() {
    for choices in [
        MethodChoices::default(),
        MethodChoices { light_pick: Some(Some(LightPick::Power)), ..Default::default() },
        MethodChoices { light_pick: Some(Some(LightPick::All)), direct: Some(Direct::Light), ..Default::default() },
        MethodChoices { light_sampling: Some(Some(LightSampling::Area)), ..Default::default() },
    ] {
        let home = image(HOME, choices.clone());
        // 1.2e-4 and 1e6.
        for power in [-13, -1, 20] {
            let there = image(Map { factor: 2f64.powi(power), place: 0.0 }, choices.clone());
            let differ = home.iter().zip(&there).filter(|(a, b)| a != b).count();
            assert_eq!(differ, 0, "{power}: {differ} of {} pixels, {choices:?}", home.len());
        }
    }
}

/// Other factors round each coordinate, by 6e-8 of it at most.
#[test]
fn any_unit_of_length_gives_the_same_picture() {
    let home = image(HOME, MethodChoices::default());
    for factor in [1e-6, 1e-4, 1e-2, 1e2, 1e4] {
        let there = image(Map { factor, place: 0.0 }, MethodChoices::default());
        check(&home, &there, 1e-3, 0.01, &format!("times {factor}"));
    }
}

/// The scene's own coordinates are exact at all of these places, but points on its surfaces are rounded to the grid of
/// f32 there: 6e-5 at 1e3, 1/16 at 1e6, of a room that is 100 wide.
#[test]
fn any_place_gives_the_same_picture() {
    let home = image(HOME, MethodChoices::default());
    for (place, bound, share) in [(1e3, 1e-3, 0.01), (1e4, 1e-3, 0.01), (1e5, 1e-3, 0.02), (1e6, 5e-3, 0.15)] {
        let there = image(Map { factor: 1.0, place }, MethodChoices::default());
        check(&home, &there, bound, share, &format!("at {place}"));
    }
}
