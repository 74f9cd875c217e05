//! Writes the meshes of scenes/meshes.

fn main() -> std::io::Result<()> {
    let scenes = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../scenes");
    for (path, bytes) in tessera_tests::meshes::all() {
        std::fs::write(scenes.join(path), &bytes)?;
        println!("{path}: {} bytes", bytes.len());
    }
    Ok(())
}
