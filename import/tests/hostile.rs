//! Whatever the bytes are: an answer, and no panic.

use import::{mesh, references};
use proptest::prelude::*;

/// Read bytes as every format, with a resolver that answers every name with `other`.
fn feed(bytes: &[u8], other: &[u8]) {
    for path in ["d/m.obj", "d/m.ply", "d/m.mtl", "d/m", "..", ""] {
        let mut resolve = |_: &str| Some(other.to_vec());
        if let Ok(imported) = mesh(path, bytes, &mut resolve) {
            for part in &imported.parts {
                let mesh = &part.mesh;
                assert!(mesh.triangles.iter().flatten().all(|&index| (index as usize) < mesh.positions.len()));
                assert!(mesh.normals.is_empty() || mesh.normals.len() == mesh.positions.len());
                assert!(mesh.uvs.is_empty() || mesh.uvs.len() == mesh.positions.len());
                assert!(mesh.positions.iter().flatten().all(|c| c.is_finite()));
            }
            let scene = import::scene_from_mesh("d/m.obj", &imported);
            assert!(scene.check().is_ok() || imported.parts.iter().all(|part| part.mesh.triangles.is_empty()));
        }
        for reference in references(path, bytes) {
            assert!(!reference.starts_with('/') && !reference.split('/').any(|part| part == ".."), "{reference}");
        }
    }
}

/// Lines made of the words that the formats know, and of numbers that they do not expect.
fn words() -> impl Strategy<Value = String> {
    let word = prop_oneof![
        prop::sample::select(vec![
            "v",
            "vt",
            "vn",
            "f",
            "l",
            "p",
            "o",
            "g",
            "s",
            "usemtl",
            "mtllib",
            "newmtl",
            "Kd",
            "Ks",
            "Ke",
            "Tf",
            "Ns",
            "Ni",
            "d",
            "Tr",
            "illum",
            "map_Kd",
            "map_d",
            "norm",
            "-s",
            "-mm",
            "-halo",
            "spectral",
            "a",
            "\\",
            "#",
            "\u{a0}",
            "1",
            "2",
            "3",
            "-1",
            "0",
            "0.5",
            "1e30",
            "-1e38",
            "nan",
            "inf",
            "1/2/3",
            "1//1",
            "-1/-1/-1",
            "1/",
            "/",
            "//",
            "-9223372036854775808",
            "9223372036854775807",
            "1/9223372036854775807",
            "../x.mtl",
            "x.png",
            "ply",
            "format",
            "ascii",
            "1.0",
            "binary_little_endian",
            "element",
            "vertex",
            "face",
            "property",
            "list",
            "uchar",
            "int",
            "float",
            "x",
            "y",
            "z",
            "vertex_indices",
            "end_header",
        ])
        .prop_map(str::to_owned),
        any::<f32>().prop_map(|n| n.to_string()),
        any::<i64>().prop_map(|n| n.to_string()),
    ];
    let line = prop::collection::vec(word, 0..6).prop_map(|words| words.join(" "));
    prop::collection::vec(line, 0..30).prop_map(|lines| lines.join("\n"))
}

const OBJ: &[u8] =
    b"mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvn 0 0 1\nusemtl m\nf 1/1/1 2/1/1 3/1/1\nf -1 -2 -3\n";
const MTL: &[u8] = b"newmtl m\nKd 1 1 1\nKs .5 .5 .5\nKe 0 0 0\nNs 10\nNi 1.5\nd 1\nillum 2\nmap_Kd -s 1 1 x.png\n";
const PLY: &[u8] = b"ply\nformat binary_little_endian 1.0\nelement vertex 3\nproperty float x\nproperty float y\n\
property float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n\
\0\0\0\0\0\0\0\0\0\0\0\0\0\0\x80\x3f\0\0\0\0\0\0\0\0\0\0\0\0\0\0\x80\x3f\0\0\0\0\x03\0\0\0\0\x01\0\0\0\x02\0\0\0";

proptest! {
    #![proptest_config(ProptestConfig { cases: 1500, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn any_bytes(bytes in prop::collection::vec(any::<u8>(), 0..400)) {
        feed(&bytes, &bytes);
    }

    #[test]
    fn any_words(text in words(), other in words()) {
        feed(text.as_bytes(), other.as_bytes());
    }

    /// Good files with bytes changed and the end cut off.
    #[test]
    fn spoilt_files(which in 0..3usize, cut in 0.0..1.0f64, at in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 0..4)) {
        let mut bytes = [OBJ, MTL, PLY][which].to_vec();
        for (index, byte) in at {
            let index = index.index(bytes.len());
            bytes[index] = byte;
        }
        bytes.truncate((bytes.len() as f64 * (1.0 - cut * cut * cut)) as usize);
        feed(&bytes, if which == 1 { OBJ } else { MTL });
        feed(OBJ, &bytes);
    }
}

#[test]
fn the_good_files_are_good_before_they_are_spoilt() {
    let mut resolve = |name: &str| (name == "m.mtl").then(|| MTL.to_vec());
    assert!(mesh("m.obj", OBJ, &mut resolve).is_ok());
    assert!(mesh("m.ply", PLY, &mut resolve).is_ok());
}

#[test]
fn a_header_that_promises_more_than_the_file_holds_reserves_nothing() {
    for header in [
        "ply\nformat binary_little_endian 1.0\nelement vertex 4294967295\nproperty float x\nend_header\n",
        "ply\nformat ascii 1.0\nelement face 18446744073709551615\nproperty list uint int vertex_indices\nend_header\n",
        "ply\nformat binary_big_endian 1.0\nelement odd 900000000000\nend_header\n",
    ] {
        feed(header.as_bytes(), b"");
    }
    let mut list = b"ply\nformat binary_little_endian 1.0\nelement face 1\nproperty list uint int vertex_indices\n\
        end_header\n"
        .to_vec();
    list.extend([0xff; 64]);
    feed(&list, b"");
}
