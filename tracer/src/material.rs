//! Materials compiled for rendering: textures are looked up here and become a BSDF at a point.

use common::{
    job::FieldError,
    method::Fresnel,
    scene::{self, MaterialKind},
};

use crate::{
    bsdf::{
        BlinnFacets, BlinnMicrofacet, BlinnPhong, Bsdf, Diffuse, GREATEST_EXPONENT, Lobes, Metal, MetallicRoughness,
        Mirror, Phong, Plastic, PlasticCoat, Reflectivity, RoughConductor, RoughDielectric, SmoothConductor,
        SmoothDielectric, SplitSum,
    },
    fresnel::{ComplexIndex, metals, normal_reflectance},
    math::{Frame, Rgb, Vec2, Vec3},
    microfacet::Ggx,
    texture::{Pictures, Texture, rgb},
};

/// A material of a scene, ready to be asked at any point.
#[derive(Debug, Clone)]
pub struct Material {
    kind: Kind,
    two_sided: bool,
    opacity: Option<Texture>,
    normal_map: Option<NormalMap>,
}

/// What is the same all over a material.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Flat {
    /// The reflectance, where it scatters by Lambert's law with one colour.
    pub diffuse: Option<Rgb>,
    /// The facets, where it is a metal with the same everywhere.
    pub facets: Option<Ggx>,
    /// Whether light is found by sampling the BSDF alone.
    pub delta: bool,
    /// Whether the back scatters as the front does.
    pub two_sided: bool,
    /// Whether light may be refracted to the other side.
    pub transmissive: bool,
}

#[derive(Debug, Clone)]
enum Kind {
    Diffuse { reflectance: Texture },
    Mirror { reflectance: Texture },
    Dielectric { eta: f32, ggx: Option<Ggx>, reflectance: Texture, transmittance: Texture, fresnel: Fresnel },
    Conductor { reflectivity: Reflectivity, ggx: Option<Ggx>, tint: Texture },
    Plastic { reflectance: Texture, coat: Box<PlasticCoat> },
    Phong { reflectance: Texture, exponent: f32 },
    BlinnPhong { reflectance: Texture, exponent: f32 },
    BlinnMicrofacet { reflectance: Texture, facets: Box<BlinnFacets> },
    MetallicRoughness { base_color: Texture, metallic: Texture, roughness: Texture, f0: f32, tables: &'static SplitSum },
}

#[derive(Debug, Clone)]
struct NormalMap {
    texture: Texture,
    scale: f32,
}

impl Material {
    /// Make a material as a scene file describes it; `path` is its place in the file.
    ///
    /// # Errors
    /// A picture that is not among `pictures`, by the field that names it.
    pub fn compile(
        path: &str,
        material: &scene::Material,
        pictures: &mut Pictures,
        fresnel: Fresnel,
    ) -> Result<Self, FieldError> {
        let mut texture =
            |field: &str, value: &scene::Texture| Texture::compile(&format!("{path}.{field}"), value, pictures);
        let kind = match &material.kind {
            MaterialKind::Diffuse(m) => Kind::Diffuse { reflectance: texture("reflectance", &m.reflectance)? },
            MaterialKind::Mirror(m) => Kind::Mirror { reflectance: texture("reflectance", &m.reflectance)? },
            MaterialKind::Dielectric(m) => {
                let eta = relative_index(m.ior / m.exterior_ior);
                Kind::Dielectric {
                    eta,
                    ggx: RoughDielectric::facets(alphas(m.roughness), eta),
                    reflectance: texture("reflectance", &m.reflectance)?,
                    transmittance: texture("transmittance", &m.transmittance)?,
                    fresnel,
                }
            }
            MaterialKind::Conductor(m) => {
                let index = match (m.metal, m.eta, m.k) {
                    (Some(metal), _, _) => Some(metals::index(metal)),
                    (None, Some(eta), Some(k)) => Some(ComplexIndex { eta: complex_part(&eta), k: complex_part(&k) }),
                    _ => None,
                };
                let [alpha_u, alpha_v] = alphas(m.roughness);
                Kind::Conductor {
                    reflectivity: match (index, fresnel) {
                        (None, _) => Reflectivity::Constant,
                        (Some(index), Fresnel::Exact) => Reflectivity::Exact(index),
                        (Some(index), Fresnel::Schlick) => Reflectivity::Schlick(index.reflectance(1.0)),
                    },
                    ggx: Ggx::new(alpha_u, alpha_v),
                    tint: texture("reflectance", &m.reflectance)?,
                }
            }
            MaterialKind::Plastic(m) => Kind::Plastic {
                reflectance: texture("reflectance", &m.reflectance)?,
                coat: Box::new(PlasticCoat::new(relative_index(m.ior), alphas(m.roughness), fresnel)),
            },
            MaterialKind::Phong(m) => {
                Kind::Phong { reflectance: texture("reflectance", &m.reflectance)?, exponent: exponent(m.exponent) }
            }
            MaterialKind::BlinnPhong(m) => Kind::BlinnPhong {
                reflectance: texture("reflectance", &m.reflectance)?,
                exponent: exponent(m.exponent),
            },
            MaterialKind::BlinnMicrofacet(m) => Kind::BlinnMicrofacet {
                reflectance: texture("reflectance", &m.reflectance)?,
                facets: Box::new(BlinnFacets::new(exponent(m.exponent))),
            },
            MaterialKind::MetallicRoughness(m) => Kind::MetallicRoughness {
                base_color: texture("base_color", &m.base_color)?,
                metallic: texture("metallic", &m.metallic)?,
                roughness: texture("roughness", &m.roughness)?,
                f0: normal_reflectance(relative_index(m.ior)),
                tables: SplitSum::get(),
            },
        };
        let opacity = material.opacity.as_ref().map(|value| texture("opacity", value)).transpose()?;
        let normal_map = material.normal_map.as_ref().map(|map| {
            let texture = Texture::vectors(&format!("{path}.normal_map"), &map.file, &map.uv, pictures)?;
            Ok(NormalMap { texture, scale: map.scale as f32 })
        });
        Ok(Self { kind, two_sided: material.two_sided, opacity, normal_map: normal_map.transpose()? })
    }

    /// Scattering where the texture coordinates are `uv`.
    #[inline]
    #[must_use]
    pub fn bsdf(&self, uv: Vec2) -> Bsdf {
        let lobes = match &self.kind {
            Kind::Diffuse { reflectance } => Lobes::Diffuse(Diffuse { reflectance: reflectance.share_at(uv) }),
            Kind::Mirror { reflectance } => Lobes::Mirror(Mirror { reflectance: reflectance.share_at(uv) }),
            Kind::Dielectric { eta, ggx, reflectance, transmittance, fresnel } => {
                let (reflectance, transmittance) = (reflectance.share_at(uv), transmittance.share_at(uv));
                let (eta, fresnel) = (*eta, *fresnel);
                match *ggx {
                    None => Lobes::SmoothDielectric(SmoothDielectric { eta, reflectance, transmittance, fresnel }),
                    Some(ggx) => {
                        Lobes::RoughDielectric(RoughDielectric { eta, reflectance, transmittance, fresnel, ggx })
                    }
                }
            }
            Kind::Conductor { reflectivity, ggx, tint } => {
                let metal = Metal { reflectivity: *reflectivity, tint: tint.share_at(uv) };
                match *ggx {
                    None => Lobes::SmoothConductor(SmoothConductor { metal }),
                    Some(ggx) => Lobes::RoughConductor(RoughConductor { metal, ggx }),
                }
            }
            Kind::Plastic { reflectance, coat } => {
                Lobes::Plastic(Plastic { reflectance: reflectance.share_at(uv), coat: **coat })
            }
            Kind::Phong { reflectance, exponent } => {
                Lobes::Phong(Phong { reflectance: reflectance.share_at(uv), exponent: *exponent })
            }
            Kind::BlinnPhong { reflectance, exponent } => {
                Lobes::BlinnPhong(BlinnPhong::new(reflectance.share_at(uv), *exponent))
            }
            Kind::BlinnMicrofacet { reflectance, facets } => {
                Lobes::BlinnMicrofacet(BlinnMicrofacet { reflectance: reflectance.share_at(uv), facets: **facets })
            }
            Kind::MetallicRoughness { base_color, metallic, roughness, f0, tables } => {
                let base = base_color.share_at(uv);
                let metallic = metallic.share_at(uv).z;
                let roughness = roughness.share_at(uv).y;
                let alpha = roughness * roughness;
                Lobes::MetallicRoughness(MetallicRoughness {
                    f0: Rgb::splat(*f0) * (1.0 - metallic) + base * metallic,
                    diffuse: base * (1.0 - metallic),
                    ggx: Ggx::new(alpha, alpha),
                    coat: tables.coat(roughness, *f0),
                })
            }
        };
        Bsdf::new(lobes, self.two_sided)
    }

    /// Share of light that meets the surface at `uv`, 0 to 1.
    #[inline]
    #[must_use]
    pub fn opacity(&self, uv: Vec2) -> f32 {
        self.opacity.as_ref().map_or(1.0, |texture| texture.mask_at(uv))
    }

    /// Whether some light may pass as though the surface were not there.
    #[must_use]
    pub fn has_opacity(&self) -> bool {
        self.opacity.as_ref().is_some_and(|texture| texture.as_constant() != Some(Rgb::ONE))
    }

    /// Whether the shading normal is taken from a picture.
    #[must_use]
    pub fn has_normal_map(&self) -> bool {
        self.normal_map.is_some()
    }

    /// Whether light may be refracted to the other side.
    #[must_use]
    pub fn is_transmissive(&self) -> bool {
        matches!(self.kind, Kind::Dielectric { .. })
    }

    /// What is the same all over it.
    #[must_use]
    pub fn flat(&self) -> Flat {
        let diffuse = match &self.kind {
            Kind::Diffuse { reflectance } => reflectance.as_constant().map(|_| reflectance.share_at(Vec2::ZERO)),
            _ => None,
        };
        let facets = match &self.kind {
            Kind::Conductor { ggx, tint, .. } => ggx.filter(|_| tint.as_constant().is_some()),
            _ => None,
        };
        Flat {
            diffuse,
            facets,
            delta: self.is_delta(),
            two_sided: self.two_sided,
            transmissive: self.is_transmissive(),
        }
    }

    /// Of a metal of one tint, what a facet reflects of light that it meets at cosine `cos`; 0 of anything else.
    #[inline]
    #[must_use]
    pub fn facet_reflectance(&self, cos: f32) -> Rgb {
        let Kind::Conductor { reflectivity, tint, .. } = &self.kind else { return Rgb::ZERO };
        Metal { reflectivity: *reflectivity, tint: tint.share_at(Vec2::ZERO) }.reflectance(cos)
    }

    /// Whether light is found by sampling the BSDF alone, wherever one looks.
    #[must_use]
    pub fn is_delta(&self) -> bool {
        let constant = self.textures().all(|texture| texture.as_constant().is_some());
        match &self.kind {
            Kind::Mirror { .. } => true,
            Kind::Dielectric { ggx, .. } | Kind::Conductor { ggx, .. } => ggx.is_none(),
            _ => constant && self.bsdf(Vec2::ZERO).is_delta(),
        }
    }

    /// Whether a delta may be among the lobes anywhere on the surface.
    #[must_use]
    pub fn has_delta(&self) -> bool {
        match &self.kind {
            Kind::Mirror { .. } => true,
            Kind::Dielectric { ggx, .. } | Kind::Conductor { ggx, .. } => ggx.is_none(),
            Kind::Plastic { coat, .. } => coat.ggx.is_none(),
            Kind::MetallicRoughness { roughness, .. } => {
                roughness.as_constant().is_none_or(|value| Ggx::new(value.y * value.y, value.y * value.y).is_none())
            }
            Kind::Diffuse { .. } | Kind::Phong { .. } | Kind::BlinnPhong { .. } | Kind::BlinnMicrofacet { .. } => false,
        }
    }

    /// Whether anything about the surface depends on texture coordinates.
    #[must_use]
    pub fn is_textured(&self) -> bool {
        let varies = |texture: &Texture| texture.as_constant().is_none();
        self.normal_map.is_some() || self.opacity.as_ref().is_some_and(varies) || self.textures().any(varies)
    }

    /// The textures that scattering depends on.
    fn textures(&self) -> impl Iterator<Item = &Texture> {
        let textures: [Option<&Texture>; 3] = match &self.kind {
            Kind::Diffuse { reflectance }
            | Kind::Mirror { reflectance }
            | Kind::Plastic { reflectance, .. }
            | Kind::Phong { reflectance, .. }
            | Kind::BlinnPhong { reflectance, .. }
            | Kind::BlinnMicrofacet { reflectance, .. } => [Some(reflectance), None, None],
            Kind::Dielectric { reflectance, transmittance, .. } => [Some(reflectance), Some(transmittance), None],
            Kind::Conductor { tint, .. } => [Some(tint), None, None],
            Kind::MetallicRoughness { base_color, metallic, roughness, .. } => {
                [Some(base_color), Some(metallic), Some(roughness)]
            }
        };
        textures.into_iter().flatten()
    }

    /// The local frame at a point: z along the shading normal `ns`, or that of the normal map; x along
    /// the part of `dpdu` square to it. `dpdu` and `dpdv` may be zero, where nothing is known of them.
    #[inline]
    #[must_use]
    pub fn frame(&self, uv: Vec2, ns: Vec3, dpdu: Vec3, dpdv: Vec3) -> Frame {
        let frame = Frame::from_normal_tangent(ns, dpdu);
        let Some(map) = &self.normal_map else { return frame };
        let encoded = map.texture.at(uv);
        let tilt =
            Vec3::new((2.0 * encoded.x - 1.0) * map.scale, (2.0 * encoded.y - 1.0) * map.scale, 2.0 * encoded.z - 1.0);
        // A mirrored texture has its v on the other side of the tangent.
        let b = if frame.b.dot(dpdv) < 0.0 { -frame.b } else { frame.b };
        let n = frame.t * tilt.x + b * tilt.y + frame.n * tilt.z;
        let length = n.length();
        // A map that points below the surface, or nowhere, tilts nothing.
        if !(tilt.z > 0.0 && length > 1e-6 && length.is_finite()) {
            return frame;
        }
        Frame::from_normal_tangent(n / length, frame.t)
    }
}

fn alphas(roughness: scene::Roughness) -> [f32; 2] {
    roughness.alphas().map(|alpha| alpha as f32)
}

/// An index of refraction within what f32 can square without overflow; beyond lies nothing but a mirror.
fn relative_index(value: f64) -> f32 {
    value.clamp(1e-4, 1e4) as f32
}

/// The same for a part of a complex one.
fn complex_part(value: &scene::Rgb) -> Vec3 {
    rgb(value).min(Vec3::splat(1e6))
}

fn exponent(value: f64) -> f32 {
    (value as f32).min(GREATEST_EXPONENT)
}

#[cfg(test)]
mod tests {
    use std::collections::HashMap;

    use common::mesh::{Encoding, Picture};

    use super::*;

    fn picture(pixels: Vec<[f32; 4]>) -> HashMap<String, Picture> {
        let width = pixels.len() as u32;
        HashMap::from([("p.png".to_owned(), Picture { width, height: 1, pixels, encoding: Encoding::Srgb })])
    }

    fn compile(json: &str, files: &HashMap<String, Picture>) -> Result<Material, FieldError> {
        let scene = serde_json::from_str(json).expect("the test's own JSON");
        Material::compile("materials.m", &scene, &mut Pictures::new(files), Fresnel::Exact)
    }

    const CENTRE: Vec2 = Vec2::splat(0.5);

    #[test]
    fn a_missing_picture_is_told_by_the_field_that_names_it() {
        let none = HashMap::new();
        let image = r#"{"type":"image","file":"a/b.png"}"#;
        for (json, field) in [
            (format!(r#"{{"type":"diffuse","reflectance":{image}}}"#), "materials.m.reflectance.file"),
            (format!(r#"{{"type":"dielectric","transmittance":{image}}}"#), "materials.m.transmittance.file"),
            (format!(r#"{{"type":"metallic_roughness","roughness":{image}}}"#), "materials.m.roughness.file"),
            (format!(r#"{{"type":"mirror","opacity":{image}}}"#), "materials.m.opacity.file"),
            (r#"{"type":"mirror","normal_map":{"file":"a/b.png"}}"#.to_owned(), "materials.m.normal_map.file"),
        ] {
            let error = compile(&json, &none).unwrap_err();
            assert_eq!(error.field, field);
            assert!(error.message.contains("a/b.png"), "{error}");
        }
    }

    #[test]
    fn metallic_is_blue_and_roughness_green() {
        let files = picture(vec![[0.9, 0.5, 0.0, 1.0]]);
        let image = r#"{"type":"image","file":"p.png","linear":true}"#;
        let json =
            format!(r#"{{"type":"metallic_roughness","base_color":0.5,"metallic":{image},"roughness":{image}}}"#);
        let textured = compile(&json, &files).unwrap();
        let plain =
            compile(r#"{"type":"metallic_roughness","base_color":0.5,"metallic":0,"roughness":0.5}"#, &HashMap::new())
                .unwrap();
        let (wo, wi) = (Vec3::new(0.6, 0.0, 0.8), Vec3::new(-0.5, 0.1, 0.86).normalize());
        assert_eq!(textured.bsdf(CENTRE).eval(wo, wi), plain.bsdf(CENTRE).eval(wo, wi));
        assert!(textured.is_textured() && !plain.is_textured());
        assert!(textured.has_delta() && !plain.has_delta() && !textured.is_delta());
    }

    #[test]
    fn facts_say_what_a_material_needs() {
        let none = HashMap::new();
        let of = |json: &str| compile(json, &none).unwrap();
        // JSON, is_delta, has_delta, is_transmissive.
        for (json, facts) in [
            (r#"{"type":"diffuse"}"#, (false, false, false)),
            (r#"{"type":"mirror"}"#, (true, true, false)),
            (r#"{"type":"dielectric"}"#, (true, true, true)),
            (r#"{"type":"dielectric","roughness":0.1}"#, (false, false, true)),
            (r#"{"type":"conductor","metal":"Ag"}"#, (true, true, false)),
            (r#"{"type":"plastic"}"#, (false, true, false)),
            (r#"{"type":"plastic","roughness":0.1}"#, (false, false, false)),
            (r#"{"type":"metallic_roughness","roughness":0}"#, (true, true, false)),
            (r#"{"type":"phong"}"#, (false, false, false)),
        ] {
            let m = of(json);
            assert_eq!((m.is_delta(), m.has_delta(), m.is_transmissive()), facts, "{json}");
        }
        let mask = of(r#"{"type":"diffuse","opacity":0.25}"#);
        assert!(mask.has_opacity() && mask.opacity(CENTRE) == 0.25);
        assert!(!of(r#"{"type":"diffuse","opacity":1}"#).has_opacity());
    }

    #[test]
    fn a_normal_map_tilts_the_frame_along_the_texture() {
        // 45 degrees towards u.
        let tilt = 0.5 + 0.5 * std::f32::consts::FRAC_1_SQRT_2;
        let files = picture(vec![[tilt, 0.5, tilt, 1.0]]);
        let m = compile(r#"{"type":"diffuse","normal_map":{"file":"p.png"}}"#, &files).unwrap();
        let frame = m.frame(CENTRE, Vec3::Z, Vec3::Y * 3.0, Vec3::NEG_X * 3.0);
        let expected = Vec3::new(0.0, 1.0, 1.0).normalize();
        assert!((frame.n - expected).length() < 1e-5, "{:?}", frame.n);
        assert!((frame.t.cross(frame.b) - frame.n).length() < 1e-5);
        assert!(frame.t.dot(Vec3::Y) > 0.7 && frame.n.dot(frame.t).abs() < 1e-6);
        // Green is up: along +v, also where the texture is mirrored.
        let files = picture(vec![[0.5, tilt, tilt, 1.0]]);
        let m = compile(r#"{"type":"diffuse","normal_map":{"file":"p.png","scale":1}}"#, &files).unwrap();
        for dpdv in [Vec3::NEG_X, Vec3::X] {
            let n = m.frame(CENTRE, Vec3::Z, Vec3::Y, dpdv).n;
            assert!((n - (dpdv + Vec3::Z).normalize()).length() < 1e-5, "{n}");
        }
        // No tilt, no tangents, and a map that points nowhere leave the normal.
        for (pixel, n) in
            [([0.5, 0.5, 1.0, 1.0], Vec3::Z), ([0.5, 0.5, 0.5, 1.0], Vec3::Y), ([1.0, 0.5, 0.0, 1.0], Vec3::X)]
        {
            let files = picture(vec![pixel]);
            let m = compile(r#"{"type":"diffuse","normal_map":{"file":"p.png"}}"#, &files).unwrap();
            let frame = m.frame(CENTRE, n, Vec3::ZERO, Vec3::ZERO);
            assert!((frame.n - n).length() < 1e-6 && frame.t.is_finite());
        }
    }

    #[test]
    fn a_bsdf_stays_small() {
        assert!(size_of::<Bsdf>() <= 160, "{}", size_of::<Bsdf>());
    }
}
