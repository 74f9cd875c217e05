//! Writes the meshes of scenes/meshes; with the argument `bench`, those of scenes/bench/meshes, which are not kept.

use tessera_tests::meshes;

fn main() -> std::io::Result<()> {
    let scenes = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../scenes");
    let bench = std::env::args().nth(1).is_some_and(|argument| argument == "bench");
    for (path, bytes) in if bench { meshes::bench::all() } else { meshes::all() } {
        let file = scenes.join(path);
        file.parent().map_or(Ok(()), std::fs::create_dir_all)?;
        std::fs::write(file, &bytes)?;
        println!("{path}: {} bytes", bytes.len());
    }
    Ok(())
}
