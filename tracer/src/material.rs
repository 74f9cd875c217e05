//! Materials compiled for rendering: textures are looked up here and become a BSDF at a point.

use common::{
    job::FieldError,
    method::Fresnel,
    scene::{self, MaterialKind},
};

use crate::{
    bsdf::{
        BlinnMicrofacet, BlinnPhong, Bsdf, Diffuse, GREATEST_EXPONENT, Lobes, Metal, MetallicRoughness, Mirror, Phong,
        Plastic, PlasticCoat, Reflectivity, RoughConductor, RoughDielectric, SmoothConductor, SmoothDielectric,
        SplitSum,
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

#[derive(Debug, Clone)]
enum Kind {
    Diffuse { reflectance: Texture },
    Mirror { reflectance: Texture },
    Dielectric { eta: f32, ggx: Option<Ggx>, reflectance: Texture, transmittance: Texture, fresnel: Fresnel },
    Conductor { reflectivity: Reflectivity, ggx: Option<Ggx>, tint: Texture },
    Plastic { reflectance: Texture, coat: Box<PlasticCoat> },
    Phong { reflectance: Texture, exponent: f32 },
    BlinnPhong { reflectance: Texture, exponent: f32 },
    BlinnMicrofacet { reflectance: Texture, exponent: f32 },
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
                let eta = (m.ior / m.exterior_ior) as f32;
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
                    (None, Some(eta), Some(k)) => Some(ComplexIndex { eta: rgb(&eta), k: rgb(&k) }),
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
                coat: Box::new(PlasticCoat::new(m.ior as f32, alphas(m.roughness), fresnel)),
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
                exponent: exponent(m.exponent),
            },
            MaterialKind::MetallicRoughness(m) => Kind::MetallicRoughness {
                base_color: texture("base_color", &m.base_color)?,
                metallic: texture("metallic", &m.metallic)?,
                roughness: texture("roughness", &m.roughness)?,
                f0: normal_reflectance(m.ior as f32),
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
            Kind::BlinnMicrofacet { reflectance, exponent } => {
                Lobes::BlinnMicrofacet(BlinnMicrofacet { reflectance: reflectance.share_at(uv), exponent: *exponent })
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

    /// Whether light is found by sampling the BSDF alone, wherever one looks.
    #[must_use]
    pub fn is_delta(&self) -> bool {
        self.bsdf(Vec2::ZERO).is_delta()
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

fn exponent(value: f64) -> f32 {
    (value as f32).min(GREATEST_EXPONENT)
}
