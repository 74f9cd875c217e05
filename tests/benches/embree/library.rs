//! Intel Embree, opened at run time: as much of its interface as a comparison needs.
//!
//! The types and constants are those of Embree 4 (`rtcore_ray.h`, `rtcore_scene.h`).

use std::{
    ffi::{CStr, CString, c_char, c_int, c_void},
    path::Path,
    ptr::null_mut,
    sync::atomic::{AtomicIsize, Ordering},
};

use anyhow::{Context, ensure};
use libloading::Library;
use tracer::geometry::{Ray, TriangleMesh};

type Handle = *mut c_void;

#[repr(C, align(16))]
struct RtcRay {
    origin: [f32; 3],
    near: f32,
    direction: [f32; 3],
    time: f32,
    far: f32,
    mask: u32,
    id: u32,
    flags: u32,
}

#[repr(C, align(16))]
struct RtcRayHit {
    ray: RtcRay,
    normal: [f32; 3],
    u: f32,
    v: f32,
    primitive: u32,
    geometry: u32,
    /// Instances, on each of as many levels as the library was built for, and room.
    instances: [u32; 9],
}

const NONE: u32 = u32::MAX;
const ROBUST: c_int = 1 << 2;
const MEDIUM_QUALITY: c_int = 1;
const TRIANGLES: c_int = 0;
const INDICES: c_int = 0;
const VERTICES: c_int = 1;
const UINT3: c_int = 0x5003;
const FLOAT3: c_int = 0x9003;
const VERSION: c_int = 0;

type Intersect = unsafe extern "C" fn(Handle, *mut RtcRayHit, Handle);
type Occluded = unsafe extern "C" fn(Handle, *mut RtcRay, Handle);

/// The library.
pub struct Embree {
    library: Library,
    intersect: Intersect,
    occluded: Occluded,
}

/// Triangles that it may build over, and a device for that.
pub struct Prepared<'a> {
    embree: &'a Embree,
    device: Handle,
    /// Shared with the library: vertices, one after the other, and how many they are.
    positions: Vec<f32>,
    vertices: usize,
    indices: Vec<[u32; 3]>,
}

/// Triangles, and the tree over them.
pub struct Scene<'a> {
    prepared: Prepared<'a>,
    scene: Handle,
    /// Bytes of the tree and what the library keeps beside it.
    pub bytes: usize,
}

/// What a closest-hit query found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Found {
    pub t: f32,
    pub primitive: u32,
}

static BYTES: AtomicIsize = AtomicIsize::new(0);

unsafe extern "C" fn monitor(_: Handle, bytes: isize, _: bool) -> bool {
    BYTES.fetch_add(bytes, Ordering::Relaxed);
    true
}

impl Embree {
    /// # Errors
    /// A file that is not there, is no library, or lacks a function.
    pub fn open(path: &Path) -> anyhow::Result<Self> {
        // SAFETY: the user names Embree; loading it runs no more than its initialisers.
        let library = unsafe { Library::new(path) }.with_context(|| format!("{}", path.display()))?;
        // SAFETY: the types are those of Embree 4's header.
        let (intersect, occluded) =
            unsafe { (*library.get::<Intersect>(b"rtcIntersect1\0")?, *library.get::<Occluded>(b"rtcOccluded1\0")?) };
        Ok(Self { library, intersect, occluded })
    }

    /// A function of the library. `T` must be its type.
    unsafe fn function<T: Copy>(&self, name: &CStr) -> anyhow::Result<T> {
        // SAFETY: the caller vouches for the type.
        Ok(unsafe { *self.library.get::<T>(name.to_bytes_with_nul())? })
    }

    /// Its version.
    pub fn version(&self) -> anyhow::Result<String> {
        // SAFETY: the types are those of Embree 4's header, and the device is released once.
        unsafe {
            let new: unsafe extern "C" fn(*const c_char) -> Handle = self.function(c"rtcNewDevice")?;
            let property: unsafe extern "C" fn(Handle, c_int) -> isize = self.function(c"rtcGetDeviceProperty")?;
            let release: unsafe extern "C" fn(Handle) = self.function(c"rtcReleaseDevice")?;
            let device = new(c"threads=1".as_ptr());
            let version = property(device, VERSION);
            release(device);
            ensure!(version >= 40_000, "Embree {version} is older than version 4");
            Ok(format!("{}.{}.{}", version / 10_000, version / 100 % 100, version % 100))
        }
    }

    /// A device of `threads` threads, and copies of a mesh for it to share.
    pub fn prepare(&self, mesh: &TriangleMesh, threads: usize) -> anyhow::Result<Prepared<'_>> {
        let configuration = CString::new(format!("threads={threads},user_threads=0,set_affinity=0"))?;
        // Each vertex is read by 16 bytes.
        let mut positions: Vec<f32> = mesh.positions.iter().flat_map(|p| p.to_array()).collect();
        positions.extend([0.0; 4]);
        // SAFETY: the types are those of Embree 4's header.
        let device = unsafe {
            let new_device: unsafe extern "C" fn(*const c_char) -> Handle = self.function(c"rtcNewDevice")?;
            let set_monitor: unsafe extern "C" fn(Handle, unsafe extern "C" fn(Handle, isize, bool) -> bool, Handle) =
                self.function(c"rtcSetDeviceMemoryMonitorFunction")?;
            let device = new_device(configuration.as_ptr());
            ensure!(!device.is_null(), "Embree gives no device");
            set_monitor(device, monitor, null_mut());
            device
        };
        let (vertices, indices) = (mesh.positions.len(), mesh.triangles.clone());
        Ok(Prepared { embree: self, device, positions, vertices, indices })
    }
}

impl<'a> Prepared<'a> {
    /// Build the tree, for the robust mode or the fast one.
    pub fn build(self, robust: bool) -> anyhow::Result<Scene<'a>> {
        let embree = self.embree;
        // SAFETY: the types are those of Embree 4's header; the buffers outlive the scene, which shares them, and
        // are as long as told.
        unsafe {
            let new_scene: unsafe extern "C" fn(Handle) -> Handle = embree.function(c"rtcNewScene")?;
            let quality: unsafe extern "C" fn(Handle, c_int) = embree.function(c"rtcSetSceneBuildQuality")?;
            let flags: unsafe extern "C" fn(Handle, c_int) = embree.function(c"rtcSetSceneFlags")?;
            let new_geometry: unsafe extern "C" fn(Handle, c_int) -> Handle = embree.function(c"rtcNewGeometry")?;
            let share: unsafe extern "C" fn(Handle, c_int, u32, c_int, *const c_void, usize, usize, usize) =
                embree.function(c"rtcSetSharedGeometryBuffer")?;
            let commit_geometry: unsafe extern "C" fn(Handle) = embree.function(c"rtcCommitGeometry")?;
            let attach: unsafe extern "C" fn(Handle, Handle) -> u32 = embree.function(c"rtcAttachGeometry")?;
            let release_geometry: unsafe extern "C" fn(Handle) = embree.function(c"rtcReleaseGeometry")?;
            let commit: unsafe extern "C" fn(Handle) = embree.function(c"rtcCommitScene")?;
            let error: unsafe extern "C" fn(Handle) -> c_int = embree.function(c"rtcGetDeviceError")?;

            BYTES.store(0, Ordering::Relaxed);
            let scene = new_scene(self.device);
            quality(scene, MEDIUM_QUALITY);
            flags(scene, if robust { ROBUST } else { 0 });
            let geometry = new_geometry(self.device, TRIANGLES);
            share(geometry, VERTICES, 0, FLOAT3, self.positions.as_ptr().cast(), 0, 12, self.vertices);
            share(geometry, INDICES, 0, UINT3, self.indices.as_ptr().cast(), 0, 12, self.indices.len());
            commit_geometry(geometry);
            attach(scene, geometry);
            release_geometry(geometry);
            commit(scene);
            let code = error(self.device);
            ensure!(code == 0, "Embree's error {code}");
            let bytes = BYTES.load(Ordering::Relaxed).max(0) as usize;
            Ok(Scene { prepared: self, scene, bytes })
        }
    }
}

impl Scene<'_> {
    #[inline]
    fn ray(ray: &Ray) -> RtcRay {
        RtcRay {
            origin: ray.origin.to_array(),
            near: 0.0,
            direction: ray.direction.to_array(),
            time: 0.0,
            far: ray.t_max,
            mask: u32::MAX,
            id: 0,
            flags: 0,
        }
    }

    #[inline]
    pub fn closest(&self, ray: &Ray) -> Option<Found> {
        let mut query = RtcRayHit {
            ray: Self::ray(ray),
            normal: [0.0; 3],
            u: 0.0,
            v: 0.0,
            primitive: NONE,
            geometry: NONE,
            instances: [NONE; 9],
        };
        // SAFETY: the scene is committed, and the query is one of Embree's, with room behind it.
        unsafe { (self.prepared.embree.intersect)(self.scene, &raw mut query, null_mut()) };
        (query.geometry != NONE).then_some(Found { t: query.ray.far, primitive: query.primitive })
    }

    #[inline]
    pub fn occluded(&self, ray: &Ray) -> bool {
        let mut query = Self::ray(ray);
        // SAFETY: the scene is committed, and the query is one of Embree's.
        unsafe { (self.prepared.embree.occluded)(self.scene, &raw mut query, null_mut()) };
        query.far < 0.0
    }
}

impl Drop for Scene<'_> {
    fn drop(&mut self) {
        // SAFETY: the type is that of Embree 4's header; the scene is released once, before its device.
        unsafe {
            let release: anyhow::Result<unsafe extern "C" fn(Handle)> =
                self.prepared.embree.function(c"rtcReleaseScene");
            if let Ok(release) = release {
                release(self.scene);
            }
        }
    }
}

impl Drop for Prepared<'_> {
    fn drop(&mut self) {
        // SAFETY: the type is that of Embree 4's header; the device is released once.
        unsafe {
            let release: anyhow::Result<unsafe extern "C" fn(Handle)> = self.embree.function(c"rtcReleaseDevice");
            if let Ok(release) = release {
                release(self.device);
            }
        }
    }
}
