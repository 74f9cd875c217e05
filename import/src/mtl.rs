//! Wavefront MTL, read by tobj, and what its materials mean here.
//!
//! As with OBJ, the text is first brought into a plain form with every number checked: tobj panics on a
//! colour of fewer than three numbers, and knows neither `Tr` nor the options before a texture's name.

use std::fmt::Write as _;

use common::{
    luminance,
    scene::{
        Conductor, Dielectric, Diffuse, Image, Material, MaterialKind, Mirror, NormalMap, Plastic, Rgb, Roughness,
        Texture, TextureKind, UvTransform, Wrap,
    },
};

use crate::{
    ImportError, Resolve,
    obj::{logical_lines, rest, shorten},
    path::{beside, extension},
};

/// Pictures that can be decoded.
const PICTURES: [&str; 4] = ["png", "jpg", "jpeg", "exr"];
/// Specular exponent from which a lobe is taken for a perfect mirror.
const MIRROR_EXPONENT: f64 = 1000.0;
/// Index of refraction where the file names none that a solid could have.
const GLASS: f64 = 1.5;

/// Materials of a library: numbers checked, textures named by paths relative to the scene's folder.
pub(crate) fn read(path: &str, bytes: &[u8], warnings: &mut Vec<String>) -> Result<Vec<tobj::Material>, ImportError> {
    if bytes.contains(&0) {
        return Err(ImportError::new(path, "is not an MTL file: it holds binary data"));
    }
    let text = String::from_utf8_lossy(bytes);
    let mut plain = Plain { path, warnings, material: String::new(), text: String::new() };
    for (number, line) in logical_lines(&text) {
        plain.line(number, &line)?;
    }
    let (materials, _) =
        tobj::load_mtl_buf(&mut plain.text.as_bytes()).map_err(|error| ImportError::new(path, error.to_string()))?;
    Ok(materials)
}

pub(crate) fn references(path: &str, bytes: &[u8]) -> Vec<String> {
    let text = String::from_utf8_lossy(bytes);
    let names = logical_lines(&text).filter_map(|(_, line)| match line.split_whitespace().next() {
        Some("map_Kd" | "map_Ks" | "map_d" | "norm") => map_name(rest(&line)).map(str::to_owned),
        _ => None,
    });
    names.filter(|name| PICTURES.contains(&extension(name).as_str())).filter_map(|name| beside(path, &name)).collect()
}

/// The file's name behind the options of a texture.
fn map_name(mut text: &str) -> Option<&str> {
    fn word(text: &str) -> (&str, &str) {
        let end = text.find(char::is_whitespace).unwrap_or(text.len());
        (&text[..end], text[end..].trim_start())
    }
    while text.starts_with('-') {
        let (option, mut after) = word(text);
        // Offsets and scales take one to three numbers, the range two, everything else one word.
        let most = match option {
            "-o" | "-s" | "-t" => 3,
            "-mm" => 2,
            _ => 1,
        };
        for i in 0..most {
            let (argument, more) = word(after);
            if i == 0 || argument.parse::<f32>().is_ok() {
                after = more;
            }
        }
        text = after;
    }
    (!text.is_empty()).then_some(text)
}

/// An MTL file on its way to what tobj reads without harm.
struct Plain<'a> {
    path: &'a str,
    warnings: &'a mut Vec<String>,
    /// Name of the material that lines belong to.
    material: String,
    text: String,
}

impl Plain<'_> {
    fn line(&mut self, number: usize, line: &str) -> Result<(), ImportError> {
        let mut words = line.split_whitespace();
        let Some(key) = words.next() else { return Ok(()) };
        if key == "newmtl" {
            self.material = rest(line).to_owned();
            if self.material.is_empty() {
                return Err(ImportError::at(self.path, number, "newmtl gives no name"));
            }
            self.put("newmtl", rest(line));
            return Ok(());
        }
        if self.material.is_empty() {
            return Ok(());
        }
        match key {
            "Kd" | "Ks" | "Ke" | "Tf" => match words.next() {
                Some("spectral" | "xyz") => self.ignore(key, "only RGB colours are read"),
                first => {
                    let rgb = self.colour(number, key, first.into_iter().chain(words))?;
                    self.put(key, &format!("{} {} {}", rgb[0], rgb[1], rgb[2]));
                }
            },
            "Ns" | "Ni" | "d" | "Tr" => match words.next() {
                Some("-halo") => self.ignore(key, "halos are not rendered"),
                Some(word) => {
                    let value = self.number(number, key, word)?;
                    match key {
                        "Tr" => self.put("d", &(1.0 - value).to_string()),
                        key => self.put(key, &value.to_string()),
                    }
                }
                None => return Err(ImportError::at(self.path, number, format!("`{key}` is followed by no number"))),
            },
            "illum" => match words.next().and_then(|word| word.parse::<u8>().ok()) {
                Some(model) => self.put("illum", &model.to_string()),
                None => self.ignore(key, "it is not the number of an illumination model"),
            },
            "map_Kd" | "map_Ks" | "map_d" | "norm" => {
                let name = map_name(rest(line)).unwrap_or("");
                match beside(self.path, name) {
                    Some(file) if PICTURES.contains(&extension(&file).as_str()) => self.put(key, &file),
                    Some(file) => self.ignore(key, &format!("{file} is not a PNG, JPEG or EXR picture")),
                    None => self.ignore(key, &format!("\"{name}\" names no file in the scene's folder")),
                }
            }
            "map_Ke" | "map_Bump" | "map_bump" | "bump" | "disp" | "decal" | "refl" => {
                self.ignore(key, "such maps are not rendered");
            }
            // Ambient light, sharpness and the like mean nothing to a path tracer.
            _ => {}
        }
        Ok(())
    }

    fn put(&mut self, key: &str, value: &str) {
        let _ = writeln!(self.text, "{key} {value}"); // writing to a String cannot fail
    }

    fn ignore(&mut self, key: &str, why: &str) {
        let Self { path, material, .. } = self;
        let warning = format!("{path}: material \"{material}\": `{key}` is left out: {why}.");
        self.warnings.push(warning);
    }

    fn number(&self, line: usize, key: &str, word: &str) -> Result<f32, ImportError> {
        word.parse::<f32>().ok().filter(|value| value.is_finite()).ok_or_else(|| {
            let message = format!("expected a finite number in `{key}`, found \"{}\"", shorten(word));
            ImportError::at(self.path, line, message)
        })
    }

    fn colour<'w>(
        &self,
        line: usize,
        key: &str,
        words: impl Iterator<Item = &'w str>,
    ) -> Result<[f32; 3], ImportError> {
        let numbers: Vec<f32> = words.take(3).map(|word| self.number(line, key, word)).collect::<Result<_, _>>()?;
        let rgb = match numbers[..] {
            [r, g, b] => [r, g, b],
            [grey] => [grey; 3],
            _ => {
                let message = format!("`{key}` has {} numbers where 3 are expected", numbers.len());
                return Err(ImportError::at(self.path, line, message));
            }
        };
        if rgb.iter().any(|&c| c < 0.0) {
            return Err(ImportError::at(self.path, line, format!("`{key}` is below 0: {rgb:?}")));
        }
        Ok(rgb)
    }
}

/// Turns a file's materials into ours.
pub(crate) struct Library<'a, 'b> {
    pub(crate) path: &'a str,
    pub(crate) resolve: &'a mut Resolve<'b>,
    pub(crate) warnings: &'a mut Vec<String>,
}

impl Library<'_, '_> {
    /// The scattering and the emitted radiance of one material.
    ///
    /// `illum` 4, 6, 7 and 9 are glass. 3 and 5 reflect their surroundings, unless the diffuse part is the
    /// larger: a metal or, without an exponent or with one above 1000, a mirror. 2 with `Ks` is a diffuse
    /// base under a coat. Anything else is diffuse. `Ns` becomes sqrt(2 / (Ns + 2)), the GGX alpha whose
    /// lobe is as wide (Walter et al. 2007, section 5.2).
    pub(crate) fn material(&mut self, source: &tobj::Material) -> (Material, Rgb) {
        let kd = self.reflectance(source, "Kd", source.diffuse.unwrap_or([0.5; 3]));
        let ks = self.reflectance(source, "Ks", source.specular.unwrap_or([0.0; 3]));
        let reflects = luminance(ks.0) > luminance(kd.0);
        let exponent = source.shininess.map(|ns| f64::from(ns).max(0.0));
        let roughness = Roughness::Isotropic((2.0 / (exponent.unwrap_or(0.0) + 2.0)).sqrt());
        let ior = source.optical_density.map(f64::from).filter(|ior| *ior > 1.0 && *ior < 10.0).unwrap_or(GLASS);
        let kind = match source.illumination_model {
            Some(4 | 6 | 7 | 9) => {
                let transmittance = Texture::Constant(filter_colour(source));
                MaterialKind::Dielectric(Dielectric { ior, transmittance, ..Dielectric::default() })
            }
            Some(3 | 5) if reflects => {
                let reflectance = self.textured(source, "map_Ks", source.specular_texture.as_deref(), ks);
                if exponent.is_none_or(|ns| ns >= MIRROR_EXPONENT) {
                    MaterialKind::Mirror(Mirror { reflectance })
                } else {
                    MaterialKind::Conductor(Conductor { reflectance, roughness, ..Conductor::default() })
                }
            }
            model => {
                let reflectance = self.textured(source, "map_Kd", source.diffuse_texture.as_deref(), kd);
                if ks.is_black() || matches!(model, Some(0 | 1)) {
                    MaterialKind::Diffuse(Diffuse { reflectance })
                } else {
                    MaterialKind::Plastic(Plastic { reflectance, ior, roughness })
                }
            }
        };
        let glass = matches!(kind, MaterialKind::Dielectric(_));
        let mut material = Material::from(kind);
        if !glass {
            material.opacity = self.opacity(source);
        }
        if let Some(file) = source.unknown_param.get("norm").filter(|file| self.exists(source, "norm", file)) {
            let (file, uv) = (file.clone(), UvTransform::default());
            material.normal_map = Some(NormalMap { file, scale: 1.0, uv });
        }
        (material, emitted(source))
    }

    /// A reflectance, at most 1.
    fn reflectance(&mut self, source: &tobj::Material, key: &str, rgb: [f32; 3]) -> Rgb {
        if rgb.iter().any(|&c| c > 1.0) {
            self.warn(source, &format!("`{key}` is cut to 1 from {rgb:?}"));
        }
        Rgb(rgb.map(|c| f64::from(c.min(1.0))))
    }

    /// The colour, or the picture multiplied by it. A black colour is a habit of exporters: the picture
    /// then stands alone.
    fn textured(&mut self, source: &tobj::Material, key: &str, file: Option<&str>, colour: Rgb) -> Texture {
        match file.filter(|file| self.exists(source, key, file)) {
            Some(file) => image(file, if colour.is_black() { Rgb::grey(1.0) } else { colour }, false),
            None => Texture::Constant(colour),
        }
    }

    fn opacity(&mut self, source: &tobj::Material) -> Option<Texture> {
        let dissolve = source.dissolve.map_or(1.0, |d| f64::from(d.clamp(0.0, 1.0)));
        match source.dissolve_texture.as_deref().filter(|file| self.exists(source, "map_d", file)) {
            Some(file) => Some(image(file, Rgb::grey(if dissolve > 0.0 { dissolve } else { 1.0 }), true)),
            None => (dissolve < 1.0).then(|| Texture::grey(dissolve)),
        }
    }

    fn exists(&mut self, source: &tobj::Material, key: &str, file: &str) -> bool {
        let found = (self.resolve)(file).is_some();
        if !found {
            self.warn(source, &format!("`{key}` is left out: the picture {file} is missing"));
        }
        found
    }

    fn warn(&mut self, source: &tobj::Material, what: &str) {
        self.warnings.push(format!("{}: material \"{}\": {what}.", self.path, source.name));
    }
}

/// Radiance that the material emits.
fn emitted(source: &tobj::Material) -> Rgb {
    Rgb(source.emissive.unwrap_or_default().map(f64::from))
}

/// `Tf`: the tint of light that passes, white where absent.
fn filter_colour(source: &tobj::Material) -> Rgb {
    let text = source.unknown_param.get("Tf").map_or("", String::as_str);
    let numbers: Vec<f64> = text.split_whitespace().filter_map(|word| word.parse().ok()).collect();
    <[f64; 3]>::try_from(numbers).map_or(Rgb::grey(1.0), |tint| Rgb(tint.map(|c| c.min(1.0))))
}

fn image(file: &str, scale: Rgb, linear: bool) -> Texture {
    let (wrap, uv) = (Wrap::default(), UvTransform::default());
    Texture::Mapped(Box::new(TextureKind::Image(Image { file: file.to_owned(), scale, linear, wrap, uv })))
}
