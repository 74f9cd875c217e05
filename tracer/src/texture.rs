//! Values that vary over a surface: constants, pictures and checkerboards by texture coordinates.
//!
//! Pictures are decoded to linear light once, when a scene is loaded. The module knows nothing of
//! materials, nor of how pictures are stored in files.

use std::{
    collections::HashMap,
    sync::{Arc, OnceLock},
};

use common::{
    job::FieldError,
    mesh::{Encoding, Picture},
    scene::{self, TextureKind, UvTransform, Wrap},
};

use crate::math::{Rgb, Vec2, Vec3};

/// The pictures of a scene, each decoded at most once however many textures show it.
#[derive(Debug)]
pub struct Pictures<'a> {
    files: &'a HashMap<String, Picture>,
    decoded: HashMap<(String, bool), Arc<Bitmap>>,
}

impl<'a> Pictures<'a> {
    /// Pictures by the relative path that the scene names them with.
    #[must_use]
    pub fn new(files: &'a HashMap<String, Picture>) -> Self {
        Self { files, decoded: HashMap::new() }
    }

    /// The picture of `file` in linear numbers; `linear` says that they are linear whatever the file says.
    fn bitmap(&mut self, field: &str, file: &str, linear: bool) -> Result<Arc<Bitmap>, FieldError> {
        if let Some(bitmap) = self.decoded.get(&(file.to_owned(), linear)) {
            return Ok(bitmap.clone());
        }
        let error = |message: String| FieldError::new(format!("{field}.file"), message);
        let picture = self.files.get(file).ok_or_else(|| error(format!("no picture \"{file}\"")))?;
        let texels = picture.width as usize * picture.height as usize;
        if texels == 0 || picture.pixels.len() != texels {
            let (w, h, n) = (picture.width, picture.height, picture.pixels.len());
            return Err(error(format!("\"{file}\" is {w}x{h} and has {n} pixels")));
        }
        let bitmap = Arc::new(Bitmap::new(picture, linear));
        self.decoded.insert((file.to_owned(), linear), bitmap.clone());
        Ok(bitmap)
    }
}

/// A picture in linear numbers, rows from the top.
#[derive(Debug)]
struct Bitmap {
    width: i32,
    height: i32,
    texels: Vec<Rgb>,
    /// Alpha of every texel, where one of them is not opaque.
    alpha: Option<Vec<f32>>,
}

impl Bitmap {
    fn new(picture: &Picture, linear: bool) -> Self {
        let decode = picture.encoding == Encoding::Srgb && !linear;
        let texel = |p: &[f32; 4]| {
            // A picture may hold anything; a texture holds numbers.
            let c = [p[0], p[1], p[2]].map(|c| if c.is_finite() { c } else { 0.0 });
            Vec3::from_array(if decode { c.map(srgb_to_linear) } else { c })
        };
        let opaque = picture.pixels.iter().all(|p| p[3] >= 1.0);
        Self {
            width: picture.width as i32,
            height: picture.height as i32,
            texels: picture.pixels.iter().map(texel).collect(),
            alpha: (!opaque).then(|| {
                picture.pixels.iter().map(|p| if p[3].is_finite() { p[3].clamp(0.0, 1.0) } else { 0.0 }).collect()
            }),
        }
    }

    /// The four texels about `uv` and their weights. Texel centres lie at half-integers; v grows upwards.
    fn footprint(&self, uv: Vec2, wrap: Wrap) -> [(usize, f32); 4] {
        let reduce = |x: f32| match wrap {
            _ if !x.is_finite() => 0.0,
            Wrap::Repeat => x - x.floor(),
            Wrap::Clamp => x.clamp(0.0, 1.0),
            Wrap::Mirror => {
                let within = x - 2.0 * (x * 0.5).floor();
                if within > 1.0 { 2.0 - within } else { within }
            }
        };
        let index = |i: i32, n: i32| match wrap {
            Wrap::Repeat => i.rem_euclid(n),
            // Within one texel of the border the mirror image of an edge is the edge itself.
            Wrap::Clamp | Wrap::Mirror => i.clamp(0, n - 1),
        } as usize;
        let x = reduce(uv.x) * self.width as f32 - 0.5;
        let y = (1.0 - reduce(uv.y)) * self.height as f32 - 0.5;
        let (x0, y0) = (x.floor(), y.floor());
        let (fx, fy) = (x - x0, y - y0);
        let (x0, y0) = (x0 as i32, y0 as i32);
        let at = |dx: i32, dy: i32| index(y0 + dy, self.height) * self.width as usize + index(x0 + dx, self.width);
        [
            (at(0, 0), (1.0 - fx) * (1.0 - fy)),
            (at(1, 0), fx * (1.0 - fy)),
            (at(0, 1), (1.0 - fx) * fy),
            (at(1, 1), fx * fy),
        ]
    }

    fn lookup(&self, uv: Vec2, wrap: Wrap) -> Rgb {
        self.footprint(uv, wrap).iter().fold(Rgb::ZERO, |sum, &(i, w)| sum + self.texels[i] * w)
    }
}

/// Inverse of sRGB's transfer curve (IEC 61966-2-1), exact to f32; below 0 by symmetry.
///
/// The power is evaluated in f64 by pure arithmetic, so the result has the same bits on every machine.
#[must_use]
pub fn srgb_to_linear(value: f32) -> f32 {
    // Pictures hold few distinct values; those of 8 bits are looked up.
    static BYTES: OnceLock<[f32; 256]> = OnceLock::new();
    let exact = |value: f32| {
        let v = f64::from(value.abs());
        let linear = if v <= 0.04045 { v / 12.92 } else { libm::pow((v + 0.055) / 1.055, 2.4) };
        (linear as f32).copysign(value)
    };
    let byte = value * 255.0;
    if (0.0..=255.0).contains(&byte) && byte.round() / 255.0 == value {
        let bytes = BYTES.get_or_init(|| std::array::from_fn(|i| exact(i as f32 / 255.0)));
        return bytes[byte.round() as usize];
    }
    exact(value)
}

/// uv' = offset + rotate(scale uv).
#[derive(Debug, Clone, Copy)]
struct UvMap {
    u: Vec2,
    v: Vec2,
    offset: Vec2,
}

impl UvMap {
    fn new(transform: &UvTransform) -> Self {
        let angle = transform.rotate.to_radians();
        let (sin, cos) = (libm::sin(angle), libm::cos(angle));
        let [su, sv] = transform.scale;
        Self {
            u: Vec2::new((cos * su) as f32, (sin * su) as f32),
            v: Vec2::new((-sin * sv) as f32, (cos * sv) as f32),
            offset: Vec2::new(transform.offset[0] as f32, transform.offset[1] as f32),
        }
    }

    fn apply(&self, uv: Vec2) -> Vec2 {
        self.offset + self.u * uv.x + self.v * uv.y
    }
}

/// A colour that may vary with texture coordinates.
#[derive(Debug, Clone)]
pub struct Texture(Kind);

#[derive(Debug, Clone)]
enum Kind {
    Constant(Rgb),
    Image(Box<Image>),
    Checkerboard { color0: Rgb, color1: Rgb, map: UvMap },
}

#[derive(Debug, Clone)]
struct Image {
    bitmap: Arc<Bitmap>,
    scale: Rgb,
    wrap: Wrap,
    map: UvMap,
}

impl Texture {
    /// The same everywhere.
    #[must_use]
    pub fn constant(value: Rgb) -> Self {
        Self(Kind::Constant(value))
    }

    /// Make a texture as a scene file describes it; `path` is the field's place in the file.
    ///
    /// # Errors
    /// A picture that is not among `pictures`, or has not the pixels it should have.
    pub fn compile(path: &str, texture: &scene::Texture, pictures: &mut Pictures) -> Result<Self, FieldError> {
        Ok(Self(match texture {
            scene::Texture::Constant(value) => Kind::Constant(rgb(value)),
            scene::Texture::Mapped(kind) => match kind.as_ref() {
                TextureKind::Image(image) => Kind::Image(Box::new(Image {
                    bitmap: pictures.bitmap(path, &image.file, image.linear)?,
                    scale: rgb(&image.scale),
                    wrap: image.wrap,
                    map: UvMap::new(&image.uv),
                })),
                TextureKind::Checkerboard(squares) => Kind::Checkerboard {
                    color0: rgb(&squares.color0),
                    color1: rgb(&squares.color1),
                    map: UvMap::new(&squares.uv),
                },
            },
        }))
    }

    /// The linear numbers of a picture that holds vectors, such as a normal map.
    pub(crate) fn vectors(
        path: &str,
        file: &str,
        uv: &UvTransform,
        pictures: &mut Pictures,
    ) -> Result<Self, FieldError> {
        Ok(Self(Kind::Image(Box::new(Image {
            bitmap: pictures.bitmap(path, file, true)?,
            scale: Rgb::ONE,
            wrap: Wrap::Repeat,
            map: UvMap::new(uv),
        }))))
    }

    /// Value at texture coordinates `uv` (v grows upwards). Coordinates that are not finite count as 0.
    #[inline]
    #[must_use]
    pub fn at(&self, uv: Vec2) -> Rgb {
        match &self.0 {
            Kind::Constant(value) => *value,
            Kind::Image(image) => image.scale * image.bitmap.lookup(image.map.apply(uv), image.wrap),
            Kind::Checkerboard { color0, color1, map } => {
                let uv = map.apply(uv);
                // Parity by arithmetic, so that far coordinates overflow nothing.
                let cell = uv.x.floor() + uv.y.floor();
                if cell - 2.0 * (cell * 0.5).floor() == 1.0 { *color1 } else { *color0 }
            }
        }
    }

    /// Value at `uv`, each channel within 0 to 1.
    #[inline]
    #[must_use]
    pub fn share_at(&self, uv: Vec2) -> Rgb {
        self.at(uv).clamp(Rgb::ZERO, Rgb::ONE)
    }

    /// One number at `uv`, 0 to 1: a picture's alpha where any of its texels is not opaque, else the mean
    /// of the channels.
    #[must_use]
    pub fn mask_at(&self, uv: Vec2) -> f32 {
        if let Kind::Image(image) = &self.0
            && let Some(alpha) = &image.bitmap.alpha
        {
            let footprint = image.bitmap.footprint(image.map.apply(uv), image.wrap);
            return footprint.iter().fold(0.0, |sum, &(i, w)| sum + alpha[i] * w).clamp(0.0, 1.0);
        }
        let value = self.share_at(uv);
        ((value.x + value.y + value.z) / 3.0).clamp(0.0, 1.0)
    }

    /// The value, where it is the same everywhere.
    #[must_use]
    pub fn as_constant(&self) -> Option<Rgb> {
        match &self.0 {
            Kind::Constant(value) => Some(*value),
            _ => None,
        }
    }
}

/// A colour of a scene file.
pub(crate) fn rgb(value: &scene::Rgb) -> Rgb {
    Vec3::from_array(value.0.map(|c| c as f32))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture(width: u32, height: u32, pixels: Vec<[f32; 4]>, encoding: Encoding) -> HashMap<String, Picture> {
        HashMap::from([("p.png".to_owned(), Picture { width, height, pixels, encoding })])
    }

    /// Compile a texture from JSON.
    fn texture(files: &HashMap<String, Picture>, json: &str) -> Result<Texture, FieldError> {
        let scene: scene::Texture = serde_json::from_str(json).expect("the test's own JSON");
        Texture::compile("materials.m.reflectance", &scene, &mut Pictures::new(files))
    }

    #[test]
    fn srgb_is_undone_to_the_last_bit() {
        // Against the curve evaluated by the standard library in f64.
        for i in 0..=10_000u32 {
            let v = i as f32 / 10_000.0;
            let x = f64::from(v);
            let expected = if x <= 0.04045 { x / 12.92 } else { ((x + 0.055) / 1.055).powf(2.4) };
            assert!((f64::from(srgb_to_linear(v)) - expected).abs() <= expected * 6.1e-8, "{v}");
        }
        for i in 0..=255u32 {
            let v = i as f32 / 255.0;
            assert!((srgb_to_linear(v) - srgb_to_linear(v + 1e-7)).abs() < 1e-6, "the table departs from the curve");
        }
        assert_eq!((srgb_to_linear(0.0), srgb_to_linear(1.0)), (0.0, 1.0));
        assert_eq!(srgb_to_linear(-0.5), -srgb_to_linear(0.5));
    }

    #[test]
    fn texels_are_read_at_their_centres_with_v_upwards() {
        let px = |v: f32| [v, v, v, 1.0];
        // Rows from the top: 0.1 0.2 / 0.3 0.4.
        let files = picture(2, 2, vec![px(0.1), px(0.2), px(0.3), px(0.4)], Encoding::Linear);
        let t = texture(&files, r#"{"type":"image","file":"p.png","wrap":"clamp"}"#).unwrap();
        for (u, v, expected) in [
            (0.25, 0.75, 0.1),
            (0.75, 0.75, 0.2),
            (0.25, 0.25, 0.3),
            (0.75, 0.25, 0.4),
            (0.5, 0.5, 0.25),
            (0.5, 0.75, 0.15),
            (-3.0, 7.0, 0.1),
        ] {
            assert!((t.at(Vec2::new(u, v)).x - expected).abs() < 1e-6, "{u} {v}");
        }
    }

    #[test]
    fn outside_the_square_a_picture_repeats_stops_or_is_mirrored() {
        let px = |v: f32| [v, v, v, 1.0];
        let files = picture(4, 1, vec![px(0.0), px(0.25), px(0.5), px(0.75)], Encoding::Linear);
        let at = |wrap: &str, u: f32| {
            let json = format!(r#"{{"type":"image","file":"p.png","wrap":"{wrap}"}}"#);
            texture(&files, &json).unwrap().at(Vec2::new(u, 0.5)).x
        };
        // Texel centres at u = 1/8, 3/8, 5/8, 7/8.
        assert_eq!(at("repeat", 1.375), 0.25);
        assert_eq!(at("repeat", -0.125), 0.75);
        assert_eq!(at("repeat", 0.0), 0.375, "half the last texel and half the first");
        assert_eq!(at("clamp", 1.375), 0.75);
        assert_eq!(at("mirror", 1.375), 0.5);
        assert_eq!(at("mirror", -0.125), 0.0);
        assert_eq!(at("mirror", 0.0), 0.0);
        for u in [f32::NAN, f32::INFINITY, -f32::INFINITY, 1e30, -1e30, f32::MIN_POSITIVE] {
            for wrap in ["repeat", "clamp", "mirror"] {
                assert!((0.0..=0.75).contains(&at(wrap, u)), "{wrap} {u}");
            }
        }
    }

    #[test]
    fn colour_is_decoded_and_data_is_not() {
        let files = picture(1, 1, vec![[0.5, 0.5, 0.5, 0.25]], Encoding::Srgb);
        let uv = Vec2::splat(0.5);
        let colour = texture(&files, r#"{"type":"image","file":"p.png","scale":2.0}"#).unwrap();
        assert!((colour.at(uv).x - 2.0 * 0.214_041_14).abs() < 1e-6);
        assert_eq!(colour.mask_at(uv), 0.25, "alpha is the mask where there is any");
        let data = texture(&files, r#"{"type":"image","file":"p.png","linear":true}"#).unwrap();
        assert_eq!(data.at(uv).x, 0.5);
    }

    #[test]
    fn a_checkerboard_counts_squares_by_its_scale_and_turns_about_the_origin() {
        let files = HashMap::new();
        let json = r#"{"type":"checkerboard","color0":1,"color1":0,"uv":{"scale":[2,4]}}"#;
        let t = texture(&files, json).unwrap();
        let at = |u, v| t.at(Vec2::new(u, v)).x;
        assert_eq!((at(0.1, 0.1), at(0.6, 0.1), at(0.1, 0.3), at(0.6, 0.3)), (1.0, 0.0, 0.0, 1.0));
        assert_eq!((at(-0.1, 0.1), at(1.1, 0.1)), (0.0, 1.0));
        assert!(at(1e30, -1e30).is_finite() && at(f32::NAN, 0.0).is_finite());
        // A quarter turn counter-clockwise takes u to v.
        let map = UvMap::new(&UvTransform { scale: [2.0, 1.0], rotate: 90.0, offset: [0.5, 0.0] });
        assert!((map.apply(Vec2::new(1.0, 0.25)) - Vec2::new(0.25, 2.0)).length() < 1e-6);
    }

    #[test]
    fn a_missing_or_broken_picture_names_its_field() {
        let json = r#"{"type":"image","file":"p.png"}"#;
        let error = texture(&HashMap::new(), json).unwrap_err();
        assert_eq!(error.field, "materials.m.reflectance.file");
        assert!(error.message.contains("p.png"));
        let short = picture(2, 2, vec![[0.0; 4]; 3], Encoding::Linear);
        assert!(texture(&short, json).unwrap_err().message.contains("2x2"));
    }
}
