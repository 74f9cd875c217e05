//! Where images go, checked before anything is rendered.

use std::{
    ffi::OsStr,
    fs,
    path::{Path, PathBuf},
};

use common::job::Frames;

use crate::error::{Failure, reason};

/// The images of a frame that a folder receives: name in the API, ending of the file.
const IMAGES: [(&str, &str); 4] =
    [("image.png", "png"), ("image.exr", "exr"), ("samples.png", "samples.png"), ("error.png", "error.png")];

/// Where images go.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Output {
    /// All images of all frames, and the report.
    Folder(PathBuf),
    /// One image.
    File(PathBuf, &'static str),
}

impl Output {
    /// Decide by the name what `path` is to be, and try whether it can be written.
    ///
    /// # Errors
    /// A format that is not written, several frames for one file, or a place that cannot be written to.
    pub fn prepare(path: &Path, frames: &Frames) -> Result<Self, Failure> {
        let shown = path.display();
        let extension = path.extension().and_then(OsStr::to_str).map(str::to_ascii_lowercase);
        let image = match extension.as_deref() {
            _ if path.is_dir() => None,
            Some("png") => Some("image.png"),
            Some("exr") => Some("image.exr"),
            Some(other @ ("jpg" | "jpeg" | "tif" | "tiff" | "bmp" | "gif" | "hdr" | "webp" | "pfm" | "json")) => {
                return Err(Failure::Input(format!(
                    "{shown}: .{other} images are not written; give FILE.png, FILE.exr or a folder"
                )));
            }
            _ => None,
        };
        match image {
            Some(image) if frames.numbers().len() == 1 => {
                let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
                try_file(folder.unwrap_or(Path::new(".")), path)?;
                Ok(Output::File(path.into(), image))
            }
            Some(_) => {
                let message = format!("{shown}: {frames} are several frames; give a folder instead of a file");
                Err(Failure::Input(message))
            }
            None => {
                folder(path)?;
                Ok(Output::Folder(path.into()))
            }
        }
    }

    /// The files to write: frame, name in the API, path.
    #[must_use]
    pub fn files(&self, frames: &[u32]) -> Vec<(u32, &'static str, PathBuf)> {
        match self {
            Output::File(path, image) => frames.iter().map(|frame| (*frame, *image, path.clone())).collect(),
            Output::Folder(folder) => {
                let of_frame = |frame: &u32| {
                    let frame = *frame;
                    IMAGES.map(|(image, ending)| (frame, image, folder.join(format!("frame-{frame:04}.{ending}"))))
                };
                frames.iter().flat_map(of_frame).collect()
            }
        }
    }

    /// Where the report goes, if anywhere.
    #[must_use]
    pub fn report(&self) -> Option<PathBuf> {
        match self {
            Output::Folder(folder) => Some(folder.join("report.json")),
            Output::File(..) => None,
        }
    }
}

/// Make a folder where there is none, and try whether it can be written to.
///
/// # Errors
/// It cannot.
pub fn folder(path: &Path) -> Result<(), Failure> {
    fs::create_dir_all(path).map_err(|error| not_writable(path, &error))?;
    tempfile::tempfile_in(path).map_err(|error| not_writable(path, &error)).map(drop)
}

/// Write a file; it appears under its name when it is whole.
///
/// # Errors
/// What the system says, with the path.
pub fn write(path: &Path, bytes: &[u8]) -> Result<(), Failure> {
    let mut partial = path.as_os_str().to_owned();
    partial.push(".part");
    let written = fs::write(&partial, bytes).and_then(|()| fs::rename(&partial, path));
    written.map_err(|error| Failure::Work(format!("{}: {}", path.display(), reason(&error))))
}

fn try_file(folder: &Path, path: &Path) -> Result<(), Failure> {
    tempfile::tempfile_in(folder).map_err(|error| not_writable(folder, &error))?;
    match fs::OpenOptions::new().append(true).open(path) {
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => Err(not_writable(path, &error)),
        _ => Ok(()),
    }
}

fn not_writable(path: &Path, error: &std::io::Error) -> Failure {
    let why = match error.kind() {
        std::io::ErrorKind::NotFound => "no such folder".into(),
        std::io::ErrorKind::AlreadyExists => "is a file, not a folder".into(),
        _ => reason(error),
    };
    Failure::Input(format!("{}: cannot be written to: {why}", path.display()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_name_decides_and_the_place_is_tried() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let one = Frames::default();
        let many: Frames = "1-3".parse().unwrap();
        assert_eq!(Output::prepare(&at("a.png"), &one), Ok(Output::File(at("a.png"), "image.png")));
        assert_eq!(Output::prepare(&at("a.EXR"), &one), Ok(Output::File(at("a.EXR"), "image.exr")));
        assert_eq!(Output::prepare(&at("new/deep"), &many), Ok(Output::Folder(at("new/deep"))));
        assert!(at("new/deep").is_dir());
        assert!(!at("a.png").exists(), "trying leaves nothing behind");

        fs::write(at("file"), "").unwrap();
        for (path, frames, expected) in [
            (at("a.jpg"), &one, ".jpg images are not written"),
            (at("a.png"), &many, "1-3 are several frames"),
            (at("nowhere/a.png"), &one, "nowhere: cannot be written to: no such folder"),
            (at("file"), &one, "is a file, not a folder"),
            (at("file/sub"), &one, "cannot be written to"),
        ] {
            let Err(Failure::Input(message)) = Output::prepare(&path, frames) else { panic!("{}", path.display()) };
            assert!(message.contains(expected), "{message}");
        }
    }

    #[test]
    fn a_folder_receives_four_images_a_frame() {
        let names: Vec<_> = Output::Folder("out".into()).files(&[1, 12345]);
        let names: Vec<String> = names.iter().map(|(_, _, path)| path.display().to_string()).collect();
        assert_eq!(
            names[..4],
            ["out/frame-0001.png", "out/frame-0001.exr", "out/frame-0001.samples.png", "out/frame-0001.error.png"]
        );
        assert_eq!(names[4], "out/frame-12345.png");
    }
}
