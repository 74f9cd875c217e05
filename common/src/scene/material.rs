//! Materials and textures, as written in a scene file.

use schemars::JsonSchema;
use serde::{Deserialize, Deserializer, Serialize};

use super::{Rgb, parse::tagged};

/// How a surface scatters light.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct Material {
    /// The scattering itself, told by `type`.
    #[serde(flatten)]
    pub kind: MaterialKind,
    /// Whether the back scatters like the front; else it is black. Glass ignores it.
    #[serde(default = "yes")]
    pub two_sided: bool,
    /// Share of light that meets the surface at all, 0 to 1: a mask.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub opacity: Option<Texture>,
    /// A tangent-space normal map.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub normal_map: Option<NormalMap>,
}

fn yes() -> bool {
    true
}

impl From<MaterialKind> for Material {
    fn from(kind: MaterialKind) -> Self {
        Self { kind, two_sided: true, opacity: None, normal_map: None }
    }
}

impl<'de> Deserialize<'de> for Material {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        #[derive(Deserialize)]
        struct Common {
            #[serde(default = "yes")]
            two_sided: bool,
            #[serde(default)]
            opacity: Option<Texture>,
            #[serde(default)]
            normal_map: Option<NormalMap>,
        }
        let mut map = serde_json::Map::deserialize(deserializer)?;
        let mut common = serde_json::Map::new();
        for key in ["two_sided", "opacity", "normal_map"] {
            if let Some((key, value)) = map.remove_entry(key) {
                common.insert(key, value);
            }
        }
        let kind = MaterialKind::from_map(map)?;
        let Common { two_sided, opacity, normal_map } = super::nested(common)?;
        Ok(Self { kind, two_sided, opacity, normal_map })
    }
}

tagged!(
    /// The kinds of scattering.
    MaterialKind {
        /// Lambert's law.
        Diffuse = "diffuse",
        /// Perfect specular reflection.
        Mirror = "mirror",
        /// Glass, water: reflection and refraction by Fresnel's equations.
        Dielectric = "dielectric",
        /// Metal.
        Conductor = "conductor",
        /// A diffuse base under a dielectric coat.
        Plastic = "plastic",
        /// Phong's lobe about the mirror direction.
        Phong = "phong",
        /// Blinn and Phong's lobe about the half vector.
        BlinnPhong = "blinn_phong",
        /// Blinn's distribution in a microfacet model.
        BlinnMicrofacet = "blinn_microfacet",
        /// glTF's metallic-roughness model.
        MetallicRoughness = "metallic_roughness",
    }
);

macro_rules! fields {
    ($(#[$doc:meta])* $name:ident { $($(#[$fdoc:meta])* $field:ident : $ty:ty = $default:expr),+ $(,)? }) => {
        $(#[$doc])*
        #[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
        #[serde(deny_unknown_fields, default)]
        pub struct $name { $($(#[$fdoc])* pub $field: $ty),+ }

        impl Default for $name {
            fn default() -> Self { Self { $($field: $default),+ } }
        }
    };
}

fields!(
    /// Lambertian reflection.
    Diffuse {
        /// Share of light reflected, 0 to 1.
        reflectance: Texture = Texture::grey(0.5),
    }
);
fields!(
    /// Perfect specular reflection.
    Mirror {
        /// Share of light reflected, 0 to 1, at every angle.
        reflectance: Texture = Texture::grey(1.0),
    }
);
fields!(
    /// A boundary between two transparent media.
    Dielectric {
        /// Index of refraction on the side the normal points away from.
        ior: f64 = 1.5,
        /// Index of refraction on the side of the normal.
        exterior_ior: f64 = 1.0,
        /// GGX alpha; 0 is smooth.
        roughness: Roughness = Roughness::Isotropic(0.0),
        /// Tint of reflected light, 0 to 1.
        reflectance: Texture = Texture::grey(1.0),
        /// Tint of refracted light, 0 to 1.
        transmittance: Texture = Texture::grey(1.0),
    }
);
fields!(
    /// A metal: by its name, by its complex index, or by its reflectance at normal incidence.
    Conductor {
        /// A measured metal. Neither this nor `eta` and `k`: a constant `reflectance`.
        metal: Option<Metal> = None,
        /// Real part of the index of refraction, per channel.
        eta: Option<Rgb> = None,
        /// Imaginary part of the index of refraction, per channel.
        k: Option<Rgb> = None,
        /// GGX alpha; 0 is smooth.
        roughness: Roughness = Roughness::Isotropic(0.0),
        /// Tint, 0 to 1; without `metal` or `eta` and `k` it stands for the Fresnel term itself.
        reflectance: Texture = Texture::grey(1.0),
    }
);
fields!(
    /// A diffuse base under a dielectric coat.
    Plastic {
        /// Reflectance of the base, 0 to 1.
        reflectance: Texture = Texture::grey(0.5),
        /// Index of refraction of the coat.
        ior: f64 = 1.5,
        /// GGX alpha of the coat; 0 is smooth.
        roughness: Roughness = Roughness::Isotropic(0.0),
    }
);
fields!(
    /// Phong's lobe about the mirror direction.
    Phong {
        /// Share of light reflected, 0 to 1.
        reflectance: Texture = Texture::grey(0.5),
        /// Exponent of the lobe, at least 0.
        exponent: f64 = 5.0,
    }
);
fields!(
    /// Blinn and Phong's lobe about the half vector.
    BlinnPhong {
        /// Reflectance at normal incidence, 0 to 1.
        reflectance: Texture = Texture::grey(0.5),
        /// Exponent of the lobe, at least 0.
        exponent: f64 = 5.0,
    }
);
fields!(
    /// Blinn's distribution in a microfacet model.
    BlinnMicrofacet {
        /// Reflectance at normal incidence, 0 to 1.
        reflectance: Texture = Texture::grey(0.5),
        /// Exponent of the distribution, at least 0.
        exponent: f64 = 5.0,
    }
);
fields!(
    /// glTF's metallic-roughness model.
    MetallicRoughness {
        /// Albedo of the dielectric part, reflectance at normal incidence of the metal.
        base_color: Texture = Texture::grey(1.0),
        /// 0 dielectric to 1 metal; a texture's blue channel.
        metallic: Texture = Texture::grey(1.0),
        /// Square root of GGX's alpha, 0 to 1; a texture's green channel.
        roughness: Texture = Texture::grey(1.0),
        /// Index of refraction of the dielectric part.
        ior: f64 = 1.5,
    }
);

/// GGX roughness: one alpha, or one along each tangent.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged, expecting = "expected an alpha, or [alpha_u, alpha_v]")]
pub enum Roughness {
    /// The same in every direction.
    Isotropic(f64),
    /// Along u and along v.
    Anisotropic([f64; 2]),
}

impl Roughness {
    /// Alpha along u and along v.
    #[must_use]
    pub fn alphas(self) -> [f64; 2] {
        match self {
            Roughness::Isotropic(alpha) => [alpha; 2],
            Roughness::Anisotropic(alphas) => alphas,
        }
    }
}

/// Metals with measured indices of refraction.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Metal {
    /// Gold.
    Au,
    /// Silver.
    Ag,
    /// Copper.
    Cu,
    /// Aluminium.
    Al,
    /// Chromium.
    Cr,
}

/// A value that may vary over a surface: a number, a colour, or a texture told by `type`.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
#[serde(untagged)]
pub enum Texture {
    /// The same everywhere.
    Constant(Rgb),
    /// Looked up by texture coordinates.
    Mapped(Box<TextureKind>),
}

impl Texture {
    /// The same grey everywhere.
    #[must_use]
    pub fn grey(value: f64) -> Self {
        Texture::Constant(Rgb::grey(value))
    }
}

impl From<Rgb> for Texture {
    fn from(rgb: Rgb) -> Self {
        Texture::Constant(rgb)
    }
}

impl<'de> Deserialize<'de> for Texture {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        use serde::de::Error;
        match serde_json::Value::deserialize(deserializer)? {
            serde_json::Value::Object(map) => TextureKind::from_map(map).map(|kind| Texture::Mapped(Box::new(kind))),
            plain => serde_json::from_value(plain).map(Texture::Constant).map_err(D::Error::custom),
        }
    }
}

tagged!(
    /// The kinds of texture.
    TextureKind {
        /// A picture.
        Image = "image",
        /// Squares of two colours.
        Checkerboard = "checkerboard",
    }
);

/// A picture looked up by texture coordinates.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Image {
    /// Relative path of a PNG, JPEG or EXR file.
    pub file: String,
    /// Multiplies every value.
    #[serde(default = "white")]
    pub scale: Rgb,
    /// Whether the numbers are data, not colour: then no sRGB curve is undone.
    #[serde(default)]
    pub linear: bool,
    /// Outside 0 to 1.
    #[serde(default)]
    pub wrap: Wrap,
    /// Change of texture coordinates.
    #[serde(default)]
    pub uv: UvTransform,
}

/// Squares of two colours, `uv.scale` of them along each axis.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Checkerboard {
    /// First colour.
    #[serde(default = "light")]
    pub color0: Rgb,
    /// Second colour.
    #[serde(default = "dark")]
    pub color1: Rgb,
    /// Change of texture coordinates.
    #[serde(default)]
    pub uv: UvTransform,
}

fn white() -> Rgb {
    Rgb::grey(1.0)
}

fn light() -> Rgb {
    Rgb::grey(0.4)
}

fn dark() -> Rgb {
    Rgb::grey(0.2)
}

/// What a picture shows outside 0 to 1.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Wrap {
    /// Itself again.
    #[default]
    Repeat,
    /// Its edge.
    Clamp,
    /// Its mirror image.
    Mirror,
}

/// uv' = offset + rotate(scale * uv), as in KHR_texture_transform.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct UvTransform {
    /// Along u and v.
    pub scale: [f64; 2],
    /// Counter-clockwise, degrees.
    pub rotate: f64,
    /// Along u and v.
    pub offset: [f64; 2],
}

impl Default for UvTransform {
    fn default() -> Self {
        Self { scale: [1.0; 2], rotate: 0.0, offset: [0.0; 2] }
    }
}

/// A tangent-space normal map, OpenGL's convention (green up).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct NormalMap {
    /// Relative path of a PNG, JPEG or EXR file; 0.5 is no tilt.
    pub file: String,
    /// Multiplies the tilt.
    #[serde(default = "one")]
    pub scale: f64,
    /// Change of texture coordinates.
    #[serde(default)]
    pub uv: UvTransform,
}

fn one() -> f64 {
    1.0
}
