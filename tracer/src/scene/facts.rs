//! What a scene needs, counted once when it is loaded: it chooses the kernel and is shown to people.

/// What is in a scene. What is not is never computed.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Facts {
    /// Mirrors, smooth glass or metal, smooth coats.
    pub delta: bool,
    /// Light passes through some surface.
    pub transmission: bool,
    /// Microfacets or lobes: anything that is neither diffuse nor perfectly smooth.
    pub rough: bool,
    /// Values that vary over a surface.
    pub textures: bool,
    /// Normal maps, or roughness with a direction: tangents are needed.
    pub tangents: bool,
    /// Shading normals other than the geometric ones.
    pub smooth_normals: bool,
    /// Opacity masks.
    pub opacity: bool,
    /// Groups placed more than once.
    pub instances: bool,
    /// Rays that leave the scene meet light.
    pub environment: bool,
    /// Surfaces that give light.
    pub area_lights: bool,
    /// Lights without a surface.
    pub delta_lights: bool,
    /// Exactly one primitive, lamp or environment gives all light: nothing is to be chosen.
    pub one_emitter: bool,
    /// Lights: surfaces, lamps and the environment; an emissive mesh is one.
    pub lights: u32,
    /// Triangles, those of instances counted once.
    pub triangles: u64,
}

impl Facts {
    /// Whether a hit needs more than its geometric normal.
    #[must_use]
    pub fn attributes(&self) -> bool {
        self.textures || self.tangents || self.smooth_normals || self.instances
    }

    /// Whether a scattered ray can find light by chance.
    #[must_use]
    pub fn light_can_be_hit(&self) -> bool {
        self.area_lights || self.environment
    }
}
