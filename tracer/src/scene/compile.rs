//! From a scene file to a [`Draft`]: every shape in its place, every name resolved.

use std::{collections::BTreeMap, sync::Arc};

use common::{
    job::FieldError,
    method::{Direct, Method, Reuse},
    scene::{self, MaterialKind, MeshSource, Normals, SceneFile, ShapeKind},
};

use super::{
    Draft, Facts, Parts, Placement, geometry_options,
    mesh::{Placed, Source, tangents},
    surface::{Attributes, NO_EMITTER, Surface, disk_axes},
    values::{Needs, check_quad, from_part, keeps_shape, linear, needs, placed_disk, rgb, scene_radius, smoothness},
};
use crate::{
    Assets,
    camera::Camera,
    geometry::{Instance, Object, Shape, TriangleMesh, World},
    light::{AreaLight, DeltaLight, Emitter, Environment, ImageEnvironment, LightSources, Lights},
    material::Material,
    math::{DAffine3, DVec3, Rgb, Vec2, Vec3},
    texture::{Pictures, Texture},
};

impl Draft {
    /// Reduce a checked scene, standing at one frame, to what rendering needs.
    ///
    /// # Errors
    /// What cannot be rendered, by its path in the scene file.
    pub fn compile(
        scene: &SceneFile,
        assets: &Assets,
        method: &Method,
        resolution: [u32; 2],
    ) -> Result<Self, FieldError> {
        let mut compiler = Compiler {
            scene,
            assets,
            method,
            pictures: Pictures::new(&assets.pictures),
            materials: Vec::new(),
            needs: Vec::new(),
            named: BTreeMap::new(),
            world: World::default(),
            surfaces: Vec::new(),
            object_surfaces: Vec::new(),
            objects: BTreeMap::new(),
            areas: Vec::new(),
            emitters: Vec::new(),
            facts: Facts::default(),
            warnings: Vec::new(),
        };
        for (i, shape) in scene.shapes.iter().enumerate() {
            compiler.shape(&format!("shapes[{i}]"), shape, DAffine3::IDENTITY, Inherited::default())?;
        }
        compiler.finish(resolution)
    }
}

/// What a shape has from the instances around it.
#[derive(Clone, Copy, Default)]
struct Inherited<'a> {
    material: Option<&'a str>,
    emission: Option<&'a scene::Emission>,
}

struct Compiler<'a> {
    scene: &'a SceneFile,
    assets: &'a Assets,
    method: &'a Method,
    pictures: Pictures<'a>,
    materials: Vec<Material>,
    /// One for each of `materials`.
    needs: Vec<Needs>,
    /// Numbers of named materials, made when first used; "" is the default.
    named: BTreeMap<String, u32>,
    world: World,
    surfaces: Vec<Surface>,
    /// Surfaces of each of `world.objects`.
    object_surfaces: Vec<Vec<Surface>>,
    /// Numbers in `world.objects` of the scene's objects.
    objects: BTreeMap<&'a str, u32>,
    areas: Vec<AreaLight>,
    /// Surface and primitive of each emitter.
    emitters: Vec<(u32, u32)>,
    facts: Facts,
    warnings: Vec<String>,
}

/// A shape made ready: its geometry, its surface, and its primitives where it gives light.
struct Made {
    shape: Shape,
    surface: Surface,
    emitters: Vec<Emitter>,
}

impl<'a> Compiler<'a> {
    /// Add a shape to the world at `place`.
    fn shape(
        &mut self,
        path: &str,
        shape: &'a scene::Shape,
        place: DAffine3,
        inherited: Inherited<'a>,
    ) -> Result<(), FieldError> {
        let to_world = place * shape.transform.affine();
        let mine = Inherited {
            material: shape.material.as_deref().or(inherited.material),
            emission: shape.emission.as_ref().or(inherited.emission),
        };
        if let ShapeKind::Instance(instance) = &shape.kind {
            return self.instance(path, &instance.object, to_world, mine);
        }
        if !keeps_shape(&shape.kind, &to_world) {
            return self.stretched(path, shape, to_world, mine);
        }
        for (made, emission) in self.make(path, shape, to_world, mine)? {
            self.add(made, emission);
        }
        Ok(())
    }

    /// Add what was made to the world, and its emitters to the lights.
    fn add(&mut self, mut made: Made, emission: Option<Light>) {
        let index = self.surfaces.len() as u32;
        if let Some(light) = emission {
            made.surface.first_emitter = self.emitters.len() as u32;
            made.surface.emitter_per_primitive = made.emitters.len() > 1;
            self.emitters.extend((0..made.emitters.len() as u32).map(|primitive| (index, primitive)));
            made.surface.emission = light.texture;
            self.areas.push(AreaLight {
                emitters: made.emitters,
                radiance: light.radiance,
                two_sided: light.two_sided,
            });
        }
        self.world.shapes.push(made.shape);
        self.surfaces.push(made.surface);
    }

    /// A group of shapes once more: shared where it is used more than once and gives no light, else copied.
    fn instance(
        &mut self,
        path: &str,
        name: &'a str,
        to_world: DAffine3,
        inherited: Inherited<'a>,
    ) -> Result<(), FieldError> {
        let scene = self.scene;
        let Some((name, shapes)) = scene.objects.get_key_value(name) else {
            return Err(FieldError::new(format!("{path}.object"), format!("no object \"{name}\"")));
        };
        let shared = inherited.material.is_none()
            && inherited.emission.is_none()
            && self.uses(name) > 1
            && shapes.iter().all(|shape| self.can_be_shared(shape));
        if !shared {
            for (i, shape) in shapes.iter().enumerate() {
                self.shape(&format!("objects.{name}[{i}]"), shape, to_world, inherited)?;
            }
            return Ok(());
        }
        let object = match self.objects.get(name.as_str()) {
            Some(&object) => object,
            None => {
                let (mut object, mut surfaces) = (Object::default(), Vec::new());
                for (i, shape) in shapes.iter().enumerate() {
                    let path = format!("objects.{name}[{i}]");
                    let own = Inherited { material: shape.material.as_deref(), emission: None };
                    for (made, _) in self.make(&path, shape, shape.transform.affine(), own)? {
                        object.shapes.push(made.shape);
                        surfaces.push(made.surface);
                    }
                }
                self.object(name, object, surfaces)
            }
        };
        self.facts.instances = true;
        self.world.instances.push(Instance { object, to_world });
        Ok(())
    }

    fn object(&mut self, name: &'a str, object: Object, surfaces: Vec<Surface>) -> u32 {
        let index = self.world.objects.len() as u32;
        self.world.objects.push(object);
        self.object_surfaces.push(surfaces);
        if !name.is_empty() {
            self.objects.insert(name, index);
        }
        index
    }

    /// A sphere or disk that its transform makes an ellipsoid or an ellipse: an instance of the round one.
    fn stretched(
        &mut self,
        path: &str,
        shape: &'a scene::Shape,
        to_world: DAffine3,
        inherited: Inherited<'a>,
    ) -> Result<(), FieldError> {
        let refuse = |what: &str| {
            let message = format!("stretches a sphere or disk that {what}; write it as a mesh");
            Err(FieldError::new(format!("{path}.transform"), message))
        };
        let (mut object, mut surfaces) = (Object::default(), Vec::new());
        for (made, emission) in self.make(path, shape, DAffine3::IDENTITY, inherited)? {
            if emission.is_some() {
                return refuse("gives light");
            }
            if !matches!(made.surface.attributes, Attributes::None) {
                return refuse("has a texture");
            }
            object.shapes.push(made.shape);
            surfaces.push(made.surface);
        }
        let object = self.object("", object, surfaces);
        self.facts.instances = true;
        self.world.instances.push(Instance { object, to_world });
        Ok(())
    }

    /// How often an object is placed, counting each place in another object once.
    fn uses(&self, name: &str) -> usize {
        let groups = self.scene.objects.values().chain(std::iter::once(&self.scene.shapes));
        let named = |shape: &&scene::Shape| matches!(&shape.kind, ShapeKind::Instance(i) if i.object == name);
        groups.map(|shapes| shapes.iter().filter(named).count()).sum()
    }

    /// Whether instances may share the shape: then it may not give light (each place is a light of its
    /// own), nor be an instance, nor have coordinates that only its own transform tells.
    fn can_be_shared(&self, shape: &scene::Shape) -> bool {
        let file_glows = |file: &str| {
            self.assets.meshes.get(file).is_some_and(|parts| parts.iter().any(|part| !part.emission.is_black()))
        };
        if shape.emission.is_some() || !keeps_shape(&shape.kind, &shape.transform.affine()) {
            return false;
        }
        match &shape.kind {
            ShapeKind::Instance(_) => false,
            ShapeKind::Mesh(mesh) => !matches!(&mesh.source, MeshSource::File { file } if file_glows(file)),
            ShapeKind::Quad(_) => true,
            ShapeKind::Sphere(_) | ShapeKind::Disk(_) => {
                let material = shape.material.as_ref().and_then(|name| self.scene.materials.get(name));
                material.is_none_or(|m| needs(m).is_nothing())
            }
        }
    }

    /// The number of a named material, or of the default one.
    fn material(&mut self, path: &str, name: Option<&str>) -> Result<u32, FieldError> {
        let key = name.unwrap_or("");
        if let Some(&index) = self.named.get(key) {
            return Ok(index);
        }
        let index = match name {
            None => self.compile_material("materials", &MaterialKind::Diffuse(Default::default()).into())?,
            Some(name) => {
                let Some(material) = self.scene.materials.get(name) else {
                    return Err(FieldError::new(format!("{path}.material"), format!("no material \"{name}\"")));
                };
                self.compile_material(&format!("materials.{name}"), material)?
            }
        };
        self.named.insert(key.to_owned(), index);
        Ok(index)
    }

    fn compile_material(&mut self, path: &str, material: &scene::Material) -> Result<u32, FieldError> {
        let compiled = Material::compile(path, material, &mut self.pictures, self.method.fresnel)?;
        let needs = needs(material);
        let facts = &mut self.facts;
        facts.textures |= needs.uv;
        facts.tangents |= needs.tangents;
        facts.opacity |= compiled.has_opacity();
        facts.transmission |= compiled.is_transmissive();
        let (delta, rough) = smoothness(&material.kind);
        facts.delta |= delta;
        facts.rough |= rough;
        self.materials.push(compiled);
        self.needs.push(needs);
        Ok(self.materials.len() as u32 - 1)
    }

    /// A shape's geometry and surface; a mesh file gives one for each of its parts.
    fn make(
        &mut self,
        path: &str,
        shape: &'a scene::Shape,
        to_world: DAffine3,
        inherited: Inherited<'a>,
    ) -> Result<Vec<(Made, Option<Light>)>, FieldError> {
        let light = match inherited.emission {
            Some(emission) => self.light(&format!("{path}.emission"), emission)?,
            None => None,
        };
        if let ShapeKind::Mesh(mesh) = &shape.kind
            && let MeshSource::File { file } = &mesh.source
        {
            let Some(parts) = self.assets.meshes.get(file) else {
                return Err(FieldError::new(format!("{path}.file"), format!("no mesh \"{file}\"")));
            };
            let mut made = Vec::with_capacity(parts.len());
            for (i, part) in parts.iter().enumerate() {
                let material = match (&part.material, inherited.material) {
                    (Some(own), None) => self.compile_material(&format!("{path}.file: part {i}"), own)?,
                    (_, name) => self.material(path, name)?,
                };
                let own = Light::constant(rgb(part.emission), false);
                let part_light = if inherited.emission.is_some() { light.clone() } else { own };
                let placed = from_part(part).place(to_world, mesh.normals);
                made.push(self.mesh(path, placed, material, part_light));
            }
            return Ok(made);
        }
        let material = self.material(path, inherited.material)?;
        let needs_uv = self.needs[material as usize].uv || light.as_ref().is_some_and(|l| l.texture.is_some());
        let round = |shape: Shape, attributes: Attributes, emitter: Emitter| Made {
            shape,
            surface: Surface {
                material,
                first_emitter: NO_EMITTER,
                emitter_per_primitive: false,
                emission: None,
                attributes: if needs_uv { attributes } else { Attributes::None },
            },
            emitters: vec![emitter],
        };
        let made = match &shape.kind {
            ShapeKind::Mesh(mesh) => {
                let MeshSource::Inline { positions, triangles, vertex_normals, uvs } = &mesh.source else {
                    return Ok(Vec::new());
                };
                let source = Source {
                    positions: positions.iter().map(|&p| DVec3::from_array(p)).collect(),
                    triangles,
                    normals: vertex_normals.iter().map(|&n| DVec3::from_array(n)).collect(),
                    uvs: uvs.iter().map(|uv| Vec2::new(uv[0] as f32, uv[1] as f32)).collect(),
                };
                return Ok(vec![self.mesh(path, source.place(to_world, mesh.normals), material, light)]);
            }
            ShapeKind::Quad(quad) => return Ok(vec![self.quad(path, quad.vertices, to_world, material, light)?]),
            ShapeKind::Sphere(sphere) => {
                let center = to_world.transform_point3(DVec3::from_array(sphere.center)).as_vec3();
                let radius = (sphere.radius * to_world.matrix3.x_axis.length()) as f32;
                let axis = |v: DVec3| v.normalize_or_zero().as_vec3();
                let m = to_world.matrix3;
                let axes = [axis(m.x_axis), axis(m.y_axis), axis(m.z_axis)];
                round(
                    Shape::Sphere { center, radius },
                    Attributes::Sphere { center, axes },
                    Emitter::Sphere { center, radius },
                )
            }
            ShapeKind::Disk(disk) => {
                let center = to_world.transform_point3(DVec3::from_array(disk.center)).as_vec3();
                let (normal, scale) = placed_disk(DVec3::from_array(disk.normal), &to_world);
                let (normal, radius) = (normal.as_vec3(), (disk.radius * scale) as f32);
                round(
                    Shape::Disk { center, normal, radius },
                    Attributes::Disk { center, axes: disk_axes(normal, radius) },
                    Emitter::Disk { center, normal, radius },
                )
            }
            ShapeKind::Instance(_) => return Ok(Vec::new()),
        };
        if needs_uv {
            self.facts.textures = true;
        }
        Ok(vec![(made, light)])
    }

    fn mesh(&mut self, path: &str, placed: Placed, material: u32, light: Option<Light>) -> (Made, Option<Light>) {
        if placed.bad > 0 {
            let (bad, all) = (placed.bad, placed.triangles.len());
            self.warnings.push(format!("{path}: {bad} of {all} triangles have no area or no finite corners"));
        }
        self.facts.triangles += placed.triangles.len() as u64;
        let Placed { positions, triangles, normals, uvs, .. } = placed;
        let emitters = match &light {
            Some(_) => triangles.iter().map(|t| Emitter::Triangle { p: t.map(|i| positions[i as usize]) }).collect(),
            None => Vec::new(),
        };
        let attributes = self.attributes(material, light.as_ref(), &positions, &triangles, normals, uvs);
        let surface =
            Surface { material, first_emitter: NO_EMITTER, emitter_per_primitive: false, emission: None, attributes };
        (Made { shape: Shape::Mesh(TriangleMesh { positions, triangles }), surface, emitters }, light)
    }

    /// Keep of a mesh what its material or its light asks for.
    fn attributes(
        &mut self,
        material: u32,
        light: Option<&Light>,
        positions: &[Vec3],
        triangles: &[[u32; 3]],
        normals: Vec<Vec3>,
        uvs: Vec<Vec2>,
    ) -> Attributes {
        let needs = self.needs[material as usize];
        let uv = needs.uv || light.is_some_and(|l| l.texture.is_some());
        let tangents = if needs.tangents { tangents(positions, triangles, &uvs) } else { Vec::new() };
        let uvs = if uv { uvs } else { Vec::new() };
        self.facts.smooth_normals |= !normals.is_empty();
        self.facts.textures |= !uvs.is_empty();
        if normals.is_empty() && uvs.is_empty() && tangents.is_empty() {
            return Attributes::None;
        }
        Attributes::Mesh { triangles: triangles.to_vec(), normals, uvs, tangents }
    }

    fn quad(
        &mut self,
        path: &str,
        vertices: [scene::Vec3; 4],
        to_world: DAffine3,
        material: u32,
        light: Option<Light>,
    ) -> Result<(Made, Option<Light>), FieldError> {
        check_quad(path, vertices.map(DVec3::from_array))?;
        let source = Source {
            positions: vertices.iter().map(|&p| DVec3::from_array(p)).collect(),
            triangles: &[[0, 1, 2], [0, 2, 3]],
            normals: Vec::new(),
            uvs: vec![Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y],
        };
        let placed = source.place(to_world, Normals::Flat);
        let corners: [Vec3; 4] = std::array::from_fn(|i| placed.positions[i]);
        let mirrored = to_world.matrix3.determinant() < 0.0;
        let (mut made, light) = self.mesh(path, placed, material, light);
        // A rectangle is one emitter. A mirror image stays two triangles: they have been turned round.
        if light.is_some() && !mirrored {
            made.emitters = Emitter::from_quad(corners);
        }
        Ok((made, light))
    }

    /// Emission of a shape; `None` where it is black.
    fn light(&mut self, path: &str, emission: &scene::Emission) -> Result<Option<Light>, FieldError> {
        let texture = Texture::compile(&format!("{path}.radiance"), &emission.radiance, &mut self.pictures)?;
        if let Some(radiance) = texture.as_constant() {
            return Ok(Light::constant(radiance, emission.two_sided));
        }
        // Its mean over the unit square stands for it where lights are weighed against each other.
        const GRID: u32 = 16;
        let at = |i: u32| (i as f32 + 0.5) / GRID as f32;
        let sum = (0..GRID * GRID).fold(Rgb::ZERO, |sum, i| sum + texture.at(Vec2::new(at(i % GRID), at(i / GRID))));
        let radiance = sum / (GRID * GRID) as f32;
        // A picture whose every sampled texel is black may still shine somewhere.
        let radiance = radiance.max(Rgb::splat(1e-6));
        Ok(Some(Light { radiance, two_sided: emission.two_sided, texture: Some(texture) }))
    }

    fn environment(&mut self) -> Result<Option<Environment>, FieldError> {
        match &self.scene.environment {
            None => Ok(None),
            Some(scene::Environment::Constant(constant)) => {
                let radiance = rgb(constant.radiance);
                Ok((radiance != Rgb::ZERO).then_some(Environment::Constant(radiance)))
            }
            Some(scene::Environment::EnvironmentImage(image)) => {
                let error = |message: String| FieldError::new("environment.file", message);
                let file = &image.file;
                let picture = self.assets.pictures.get(file).ok_or_else(|| error(format!("no picture \"{file}\"")))?;
                let (w, h) = (picture.width as usize, picture.height as usize);
                let made = ImageEnvironment::new(w, h, linear(picture), rgb(image.scale), &image.transform.affine());
                let made = made.ok_or_else(|| error(format!("\"{file}\" has no pixels")))?;
                let compensated = matches!(self.method.direct, Direct::Mis | Direct::Auto);
                Ok(Some(Environment::Image(Arc::new(if compensated { made.compensated() } else { made }))))
            }
        }
    }

    fn finish(mut self, resolution: [u32; 2]) -> Result<Draft, FieldError> {
        let deltas: Vec<DeltaLight> = self.scene.lights.iter().filter_map(DeltaLight::from_scene).collect();
        let environment = self.environment()?;
        let masked = |s: &Surface| s.first_emitter != NO_EMITTER && self.materials[s.material as usize].has_opacity();
        let emission_varies = self.surfaces.iter().any(|s| s.emission.is_some() || masked(s));
        let facts = &mut self.facts;
        facts.environment = environment.is_some();
        facts.area_lights = !self.areas.is_empty();
        facts.delta_lights = !deltas.is_empty();
        facts.one_emitter = self.emitters.len() + deltas.len() + usize::from(environment.is_some()) == 1;
        facts.emitters = self.emitters.len() as u32;
        facts.lights = (self.areas.len() + deltas.len() + usize::from(environment.is_some())) as u32;
        if facts.lights == 0 {
            self.warnings.push("no light in the scene: the image will be black".into());
        }
        let method = self.method.direct;
        if facts.delta_lights && matches!(method, Direct::Bsdf | Direct::Hemisphere) {
            self.warnings
                .push(format!("--direct {method} finds no light without a surface: point, spot and directional"));
        }
        if facts.opacity && self.method.reuse != Reuse::Off {
            self.warnings.push(format!("--reuse {} shares nothing: the scene has opacity masks", self.method.reuse));
        }
        let sources = LightSources { areas: self.areas, deltas, environment, scene_radius: scene_radius(&self.world) };
        let lights = Lights::build(sources, self.method);
        let mut first = vec![0; self.object_surfaces.len()];
        for (object, surfaces) in self.object_surfaces.into_iter().enumerate() {
            first[object] = self.surfaces.len() as u32;
            self.surfaces.extend(surfaces);
        }
        let instances =
            self.world.instances.iter().map(|i| Placement::new(first[i.object as usize], i.to_world)).collect();
        let scene = Parts {
            camera: Camera::new(&self.scene.camera, self.scene.film.filter, resolution),
            flats: self.materials.iter().map(Material::flat).collect(),
            materials: self.materials,
            surfaces: self.surfaces,
            instances,
            emitters: if emission_varies { self.emitters } else { Vec::new() },
            facts: self.facts,
        };
        Ok(Draft { world: self.world, scene, lights, options: geometry_options(self.method), warnings: self.warnings })
    }
}

/// Emission of one shape.
#[derive(Clone)]
struct Light {
    radiance: Rgb,
    two_sided: bool,
    texture: Option<Texture>,
}

impl Light {
    fn constant(radiance: Rgb, two_sided: bool) -> Option<Self> {
        (radiance.max_element() > 0.0).then_some(Self { radiance, two_sided, texture: None })
    }
}
