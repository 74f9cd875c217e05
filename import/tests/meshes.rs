//! What OBJ, MTL and PLY files become, and what is said about their faults.

use common::{
    mesh::{Mesh, MeshPart},
    scene::{MaterialKind, Rgb, Roughness, Texture, TextureKind},
};
use import::{ImportError, Imported, mesh, references};

/// Read a file beside which there are `others`.
fn read(path: &str, bytes: &[u8], others: &[(&str, &str)]) -> Result<Imported, ImportError> {
    let mut resolve =
        |name: &str| others.iter().find(|(other, _)| *other == name).map(|(_, text)| text.as_bytes().to_vec());
    mesh(path, bytes, &mut resolve)
}

fn obj(text: &str) -> Imported {
    read("m.obj", text.as_bytes(), &[]).unwrap()
}

/// Every triangle's corners as positions: what a mesh is, whatever the order of its vertices.
fn corners(mesh: &Mesh) -> Vec<[[f32; 3]; 3]> {
    mesh.triangles.iter().map(|t| t.map(|index| mesh.positions[index as usize])).collect()
}

const SQUARE: &str = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n";

#[test]
fn what_is_written_is_read_back() {
    let mut text = String::new();
    let mut expected = Vec::new();
    for i in 0..100u32 {
        let p = |k: u32| [(i * 3 + k) as f32 * 0.1, (i ^ k) as f32 / 3.0, -(k as f32)];
        for k in 0..3 {
            let [x, y, z] = p(k);
            text += &format!("v {x} {y} {z}\nvt {} {}\nvn 0 0 1\n", x / 40.0, y / 40.0);
        }
        let n = i * 3;
        text += &format!("f {a}/{a}/{a} {b}/{b}/{b} {c}/{c}/{c}\n", a = n + 1, b = n + 2, c = n + 3);
        expected.push([p(0), p(1), p(2)]);
    }
    let imported = obj(&text);
    assert_eq!(imported.parts.len(), 1);
    let mesh = &imported.parts[0].mesh;
    assert_eq!(corners(mesh), expected, "shortest decimal form of an f32 reads back as the same f32");
    assert_eq!(mesh.normals, vec![[0.0, 0.0, 1.0]; 300]);
    assert_eq!(mesh.uvs[5], [mesh.positions[5][0] / 40.0, mesh.positions[5][1] / 40.0]);
    assert_eq!(imported.warnings, Vec::<String>::new());
}

#[test]
fn polygons_become_triangles_of_the_same_winding() {
    let quad = obj(&format!("{SQUARE}f 1 2 3 4\n"));
    let expected = [[[0., 0., 0.], [1., 0., 0.], [1., 1., 0.]], [[0., 0., 0.], [1., 1., 0.], [0., 1., 0.]]];
    assert_eq!(corners(&quad.parts[0].mesh), expected);
    let pentagon = obj(&format!("{SQUARE}v -1 0.5 0\nf 1 2 3 4 5\n"));
    assert_eq!(pentagon.parts[0].mesh.triangles.len(), 3);
}

#[test]
fn negative_indices_count_from_the_end_so_far() {
    let text = "v 9 9 9\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 1\nf -3//-1 -2//-1 -1//-1\nv 5 5 5\nf 1 2 3\n";
    let triangles = corners(&obj(text).parts[0].mesh);
    assert_eq!(triangles[0], [[0., 0., 0.], [1., 0., 0.], [0., 1., 0.]]);
}

#[test]
fn a_face_may_refer_to_vertices_further_down() {
    assert_eq!(obj(&format!("f 1 2 3\n{SQUARE}")).parts[0].mesh.triangles.len(), 1);
}

#[test]
fn groups_do_not_cut_a_surface_into_parts() {
    let imported = obj(&format!("{SQUARE}o a\nf 1 2 3\ng b\nf 1 3 4\n"));
    assert_eq!(imported.parts.len(), 1);
    assert_eq!(imported.parts[0].mesh.positions.len(), 4, "the shared edge has one pair of vertices");
}

#[test]
fn forms_that_other_readers_stumble_over() {
    // Windows line ends, a continued line, a weight, vertex colours, comments that are not UTF-8, one-dimensional
    // texture coordinates.
    let mut bytes = b"# Gr\xfc\xdfe\r\nv 0 0 0 1\r\nv 1 0 0 0.5 0.5 0.5\r\nv 1 1 0\r\nv 0 1 0\r\nvt 0.5\r\n".to_vec();
    bytes.extend_from_slice(b"f 1/1 2/1 \\\r\n3/1 4/1\r\nl 1 2\r\np 1\r\n");
    let imported = read("m.obj", &bytes, &[]).unwrap();
    assert_eq!(imported.parts[0].mesh.triangles.len(), 2);
    assert_eq!(imported.parts[0].mesh.uvs, vec![[0.5, 0.0]; 4]);
    assert_eq!(imported.warnings.len(), 2, "{:?}", imported.warnings);
}

#[test]
fn normals_stay_only_where_every_corner_has_one() {
    let imported = obj(&format!("{SQUARE}vn 0 0 1\nf 1//1 2//1 3//1\nf 1 3 4\n"));
    let mesh = &imported.parts[0].mesh;
    assert_eq!((mesh.triangles.len(), mesh.normals.len()), (2, 0));
}

#[test]
fn faults_are_named_with_their_line() {
    for (text, expected) in [
        ("", "m.obj: holds no faces: not an OBJ file, or cut short"),
        ("hello\nworld\n", "m.obj: holds no faces"),
        ("v 0 0 0\nv 1 0 0\nv 0 1", "m.obj: line 3: `v` has 2 numbers where 3 are expected"),
        ("v 0 0 nan\n", "m.obj: line 1: expected a finite number in `v`, found \"nan\""),
        ("v 0 0 1e99\n", "m.obj: line 1: expected a finite number in `v`, found \"1e99\""),
        ("v 0 0 0\nvn 0 x 0\n", "m.obj: line 2: expected a finite number in `vn`, found \"x\""),
        ("v 0 0 0\nf 1 1", "m.obj: line 2: a face has at least 3 corners, found 2"),
        ("v 0 0 0\nf 1 1 2\n", "m.obj: line 2: the face refers to vertex 2, and there are 1"),
        ("v 0 0 0\nf 1 1 -2\n", "m.obj: line 2: the face refers to vertex -2, and there are 1 so far"),
        ("v 0 0 0\nf 1 1 0\n", "m.obj: line 2: expected the index of a vertex, found \"0\""),
        ("v 0 0 0\nf 1 1 1/\n", ""),
        ("v 0 0 0\nf 1/1 1/1 1/1\n", "m.obj: line 2: the face refers to texture coordinate 1, and there are 0"),
        ("v 0 0 0\nf 1//1 1//1 1//1\n", "m.obj: line 2: the face refers to normal 1, and there are 0"),
        ("v 0 0 0\nf 1 1 1/-9223372036854775808\n", "m.obj: line 2: the face refers to texture coordinate -9223372"),
        ("v 0 0 0\nf 1 1 99999999999999999999\n", "m.obj: line 2: expected the index of a vertex"),
        ("v 0 0 0\nf 1 1 1/1/1/1\n", "m.obj: line 2: expected v/vt/vn, found \"1/1/1/1\""),
        ("v 0 0 0\nusemtl\nf 1 1 1\n", "m.obj: line 2: usemtl names no material"),
        ("v 0 0 0\n\0", "m.obj: is not an OBJ file: it holds binary data"),
    ] {
        let found = read("m.obj", text.as_bytes(), &[]);
        if expected.is_empty() {
            found.unwrap();
        } else {
            let found = found.expect_err(text).to_string();
            assert!(found.starts_with(expected), "{text:?}\n found {found}\n expected {expected}");
        }
    }
    let error = read("m.stl", b"solid", &[]).unwrap_err().to_string();
    assert!(error.contains("\".stl\" is not a mesh format that is known"), "{error}");
}

/// Read one triangle that uses material `m` of this library.
fn part(mtl: &str, pictures: &[&str]) -> (MeshPart, Vec<String>) {
    let text = format!("mtllib sub/m.mtl\nusemtl m\n{SQUARE}f 1 2 3\n");
    let mut others = vec![("dir/sub/m.mtl", mtl)];
    others.extend(pictures.iter().map(|name| (*name, "")));
    let mut imported = read("dir/m.obj", text.as_bytes(), &others).unwrap();
    (imported.parts.remove(0), imported.warnings)
}

#[test]
fn materials_become_what_their_numbers_say() {
    let kind = |mtl: &str| part(&format!("newmtl m\n{mtl}"), &[]).0.material.unwrap().kind;
    let grey = |value: f64| Texture::Constant(Rgb([value; 3]));
    let MaterialKind::Diffuse(diffuse) = kind("Kd 0.25 0.5 0.75\nillum 1\nKs 1 1 1\n") else { panic!() };
    assert_eq!(diffuse.reflectance, Texture::Constant(Rgb([0.25, 0.5, 0.75])));
    let MaterialKind::Diffuse(diffuse) = kind("Kd 0.5") else { panic!("one number is a grey") };
    assert_eq!(diffuse.reflectance, grey(0.5));
    let MaterialKind::Plastic(plastic) = kind("Kd 0.5 0.5 0.5\nKs 0.5 0.5 0.5\nNs 198\nNi 1.25\nillum 2\n") else {
        panic!()
    };
    assert_eq!((plastic.ior, plastic.roughness), (1.25, Roughness::Isotropic(0.1)));
    let MaterialKind::Mirror(mirror) = kind("Kd 0 0 0\nKs 0.75 0.75 0.75\nNs 1000\nillum 5\n") else { panic!() };
    assert_eq!(mirror.reflectance, grey(0.75));
    let MaterialKind::Conductor(metal) = kind("Kd 0 0 0\nKs 0.75 0.75 0.75\nNs 6\nillum 3\n") else { panic!() };
    assert_eq!(metal.roughness, Roughness::Isotropic(0.5));
    let MaterialKind::Dielectric(glass) = kind("Ni 1.25\nTf 1 0.5 1\nd 0.5\nillum 7\n") else { panic!() };
    assert_eq!((glass.ior, glass.transmittance), (1.25, Texture::Constant(Rgb([1.0, 0.5, 1.0]))));

    let (lamp, _) = part("newmtl m\nKd 0 0 0\nKe 4 3 2\n", &[]);
    assert_eq!(lamp.emission, Rgb([4.0, 3.0, 2.0]));
    for transparency in ["d 0.25", "Tr 0.75"] {
        let (veil, _) = part(&format!("newmtl m\n{transparency}\n"), &[]);
        assert_eq!(veil.material.unwrap().opacity, Some(grey(0.25)));
    }
}

#[test]
fn textures_are_named_relative_to_the_scene_and_missing_ones_are_said() {
    let mtl = "newmtl m\nKd 0.5 0.5 0.5\nmap_Kd -s 2 2 -clamp on ..\\wood grain.png\nmap_Bump bump.png\n";
    let (found, warnings) = part(mtl, &["dir/wood grain.png"]);
    let MaterialKind::Diffuse(diffuse) = found.material.unwrap().kind else { panic!() };
    let Texture::Mapped(kind) = diffuse.reflectance else { panic!("{:?}", diffuse.reflectance) };
    let TextureKind::Image(image) = *kind else { panic!() };
    assert_eq!((image.file.as_str(), image.scale), ("dir/wood grain.png", Rgb([0.5; 3])));
    assert!(warnings.len() == 1 && warnings[0].contains("map_Bump"), "{warnings:?}");

    let (found, warnings) = part(mtl, &[]);
    let MaterialKind::Diffuse(diffuse) = found.material.unwrap().kind else { panic!() };
    assert_eq!(diffuse.reflectance, Texture::Constant(Rgb([0.5; 3])), "the colour stays");
    assert!(warnings.iter().any(|w| w.contains("dir/wood grain.png is missing")), "{warnings:?}");
}

#[test]
fn a_missing_library_or_material_is_a_warning() {
    let text = format!("mtllib none.mtl\nusemtl ghost\n{SQUARE}f 1 2 3\n");
    let imported = read("m.obj", text.as_bytes(), &[]).unwrap();
    assert_eq!(imported.parts[0].material, None);
    assert_eq!(
        imported.warnings,
        [
            "m.obj: the material file \"none.mtl\" is missing; its materials get the default.",
            "m.obj: no material \"ghost\" is defined; its faces get the default.",
        ]
    );
}

#[test]
fn one_part_a_material_however_often_it_changes() {
    let mtl = "newmtl a\nKd 1 0 0\nnewmtl b\nKd 0 1 0\n";
    let text = format!("mtllib m.mtl\n{SQUARE}usemtl a\nf 1 2 3\nusemtl b\nf 1 3 4\nusemtl a\nf 2 3 4\n");
    let imported = read("m.obj", text.as_bytes(), &[("m.mtl", mtl)]).unwrap();
    let counts: Vec<usize> = imported.parts.iter().map(|part| part.mesh.triangles.len()).collect();
    assert_eq!(counts, [2, 1]);
    assert_eq!(corners(&imported.parts[0].mesh)[1], [[1., 0., 0.], [1., 1., 0.], [0., 1., 0.]]);
}

#[test]
fn faults_of_a_library_name_its_file_and_line() {
    for (mtl, expected) in [
        ("newmtl m\nKd 1 1\n", "dir/sub/m.mtl: line 2: `Kd` has 2 numbers where 3 are expected"),
        ("newmtl m\nKd\n", "dir/sub/m.mtl: line 2: `Kd` has 0 numbers"),
        ("newmtl m\nKd 1 nan 1\n", "dir/sub/m.mtl: line 2: expected a finite number in `Kd`, found \"nan\""),
        ("newmtl m\nKe -1 0 0\n", "dir/sub/m.mtl: line 2: `Ke` is below 0"),
        ("newmtl m\nNs\n", "dir/sub/m.mtl: line 2: `Ns` is followed by no number"),
        ("newmtl\n", "dir/sub/m.mtl: line 1: newmtl gives no name"),
    ] {
        let text = format!("mtllib sub/m.mtl\nusemtl m\n{SQUARE}f 1 2 3\n");
        let found = read("dir/m.obj", text.as_bytes(), &[("dir/sub/m.mtl", mtl)]).unwrap_err().to_string();
        assert!(found.starts_with(expected), "{mtl:?}\n found {found}\n expected {expected}");
    }
}

#[test]
fn references_are_what_must_be_uploaded() {
    assert_eq!(references("a/m.obj", b"mtllib x.mtl\nmtllib x.mtl\n mtllib ../y.mtl\n"), ["a/x.mtl", "y.mtl"]);
    assert_eq!(references("m.obj", b"mtllib a.mtl b.mtl\n"), ["a.mtl b.mtl", "a.mtl", "b.mtl"]);
    let mtl = b"newmtl m\nmap_Kd wood.png\nnorm -bm 1 n.JPG\nmap_Kd wood.png\nmap_d ../../up.png\nmap_Ks z.tga\n";
    assert_eq!(references("a/m.mtl", mtl), ["a/wood.png", "a/n.JPG"]);
    assert_eq!(references("m.ply", b"ply\n"), Vec::<String>::new());
}

const ASCII: &str = "ply\nformat ascii 1.0\ncomment by hand\nelement vertex 4\nproperty float x\nproperty double y\n\
    property float z\nproperty uchar red\nproperty float s\nproperty float t\nelement face 1\n\
    property list uchar int vertex_indices\nend_header\n0 0 0 255 0 0\n1 0 0 0 1 0\n1 1 0 0 1 1\n0 1 0 0 0 1\n4 0 1 2 3\n";

/// The same square, binary, in either byte order.
fn binary(big: bool) -> Vec<u8> {
    let order = if big { "big" } else { "little" };
    let mut bytes = format!(
        "ply\nformat binary_{order}_endian 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
         element face 1\nproperty list uchar uint vertex_index\nend_header\n"
    )
    .into_bytes();
    let mut put = |word: [u8; 4]| bytes.extend(word.iter().rev());
    let mut number = |bits: u32| put(if big { bits.to_le_bytes() } else { bits.to_be_bytes() });
    for v in [0., 0., 0., 1., 0., 0., 1., 1., 0., 0., 1., 0f32] {
        number(v.to_bits());
    }
    bytes.push(4);
    for i in 0..4u32 {
        bytes.extend(if big { i.to_be_bytes() } else { i.to_le_bytes() });
    }
    bytes
}

#[test]
fn ply_reads_alike_in_every_encoding() {
    let expected = corners(&obj(&format!("{SQUARE}f 1 2 3 4\n")).parts[0].mesh);
    let ascii = read("m.ply", ASCII.as_bytes(), &[]).unwrap();
    assert_eq!(corners(&ascii.parts[0].mesh), expected);
    assert_eq!(ascii.parts[0].mesh.uvs, [[0., 0.], [1., 0.], [1., 1.], [0., 1.]]);
    assert_eq!(ascii.warnings, ["m.ply: the colours of its vertices are not rendered."]);
    for big in [false, true] {
        assert_eq!(corners(&read("m.PLY", &binary(big), &[]).unwrap().parts[0].mesh), expected, "big endian: {big}");
    }
}

/// Binary triangles, which are read in place, with a quad among them, which makes them all go through the parser.
#[test]
fn ply_triangles_read_alike_in_place_and_by_the_parser() {
    let file = |quad: bool, kind: &str, negative: bool| {
        let faces = 3 + u32::from(quad);
        let mut bytes = format!(
            "ply\nformat binary_little_endian 1.0\nelement vertex 4\nproperty float nx\nproperty float x\nproperty float y\n\
             property float ny\nproperty float z\nproperty float nz\nproperty float odd\nelement face {faces}\n\
             property list uchar {kind} vertex_indices\nelement tail 1\nproperty uchar x\nend_header\n"
        )
        .into_bytes();
        for i in 0..28u8 {
            bytes.extend(f32::from(i).to_le_bytes());
        }
        for face in [[0, 1, 2], [2, 1, 3], [3, if negative { -1 } else { 0 }, 1i32]] {
            bytes.push(3);
            bytes.extend(face.iter().flat_map(|i| i.to_le_bytes()));
        }
        if quad {
            bytes.push(4);
            bytes.extend([0, 1, 2, 3i32].iter().flat_map(|i| i.to_le_bytes()));
        }
        bytes.push(9);
        bytes
    };
    for kind in ["int", "uint"] {
        let fast = read("m.ply", &file(false, kind, false), &[]).unwrap().parts.remove(0).mesh;
        let slow = read("m.ply", &file(true, kind, false), &[]).unwrap().parts.remove(0).mesh;
        assert_eq!(fast.triangles, [[0, 1, 2], [2, 1, 3], [3, 0, 1]]);
        assert_eq!(slow.triangles, [&fast.triangles[..], &[[0, 1, 2], [0, 2, 3]]].concat());
        assert_eq!((fast.positions[1], fast.normals[1]), ([8.0, 9.0, 11.0], [7.0, 10.0, 12.0]));
        assert_eq!((&fast.positions, &fast.normals), (&slow.positions, &slow.normals));
        assert!(read("m.ply", &file(false, kind, true), &[]).is_err());
    }
}

#[test]
fn ply_faults_are_one_sentence() {
    let error = |text: &str| {
        let error = read("m.ply", text.as_bytes(), &[]).expect_err(text).to_string();
        assert!(!error.contains('\n'), "{error}");
        error
    };
    assert!(error("solid").contains("does not begin with \"ply\""));
    for (from, to, expected) in [
        ("4 0 1 2 3", "4 0 1 2 4", "a face refers to vertex 4, and there are 4"),
        ("4 0 1 2 3", "4 0 1 2 -1", "face 0 has no list of vertex indices at or above 0"),
        ("4 0 1 2 3", "2 0 1", "face 0 has 2 corners"),
        ("4 0 1 2 3\n", "", "nexpected end of file"),
        ("1 1 0 0 1 1", "1 nan 0 0 1 1", "m.ply: line 16: Couldn't read element line"),
        ("face 1", "face 99999999999", "99999999999 elements \"face\" do not fit"),
        ("property float z\n", "", "its vertices have no x, y and z"),
        ("face 1", "face 0", "holds no faces"),
        ("end_header\n", "element odd 9\nend_header\n", "9 elements \"odd\" have no properties"),
    ] {
        assert!(ASCII.contains(from));
        let found = error(&ASCII.replace(from, to));
        assert!(found.starts_with("m.ply: ") && found.contains(expected), "{to}\n found {found}\n expected {expected}");
    }
    let mut spoilt = binary(false);
    let second = spoilt.windows(4).position(|word| word == 1f32.to_le_bytes()).unwrap();
    spoilt[second..second + 4].copy_from_slice(&f32::NAN.to_le_bytes());
    let error = read("m.ply", &spoilt, &[]).unwrap_err().to_string();
    assert_eq!(error, "m.ply: vertex 1 holds a number that is not finite");
    for length in 0..binary(false).len() {
        read("m.ply", &binary(false)[..length], &[]).unwrap_err();
    }
}
