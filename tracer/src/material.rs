//! Materials compiled for rendering: textures are looked up here and become a BSDF at a point.

use common::{
    job::FieldError,
    method::Fresnel,
    scene::{self, MaterialKind},
};

use crate::{
    bsdf::{Bsdf, Diffuse, Lobes, Mirror, SmoothDielectric},
    math::{Frame, Rgb, Vec2, Vec3},
    texture::{Pictures, Texture},
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
    Dielectric { eta: f32, reflectance: Texture, transmittance: Texture, fresnel: Fresnel },
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
            MaterialKind::Dielectric(m) => Kind::Dielectric {
                eta: (m.ior / m.exterior_ior) as f32,
                reflectance: texture("reflectance", &m.reflectance)?,
                transmittance: texture("transmittance", &m.transmittance)?,
                fresnel,
            },
            _ => return Err(FieldError::new(format!("{path}.type"), "this material cannot be rendered yet")),
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
            Kind::Dielectric { eta, reflectance, transmittance, fresnel } => {
                Lobes::SmoothDielectric(SmoothDielectric {
                    eta: *eta,
                    reflectance: reflectance.share_at(uv),
                    transmittance: transmittance.share_at(uv),
                    fresnel: *fresnel,
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
