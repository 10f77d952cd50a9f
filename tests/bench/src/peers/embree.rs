//! Embree's side: each of its calls, for single rays, packets and streams.

use super::Peer;
use super::embree_calls::surfaces::{Cage, Grids};
use super::embree_calls::{
    Context, NONE, Options, RtcHit, RtcHits, RtcRay, RtcRayHit, RtcRayHits, RtcRays, Scene, Valid,
};
use crate::placed::Placed;
use crate::rays::Batch;
use crate::scenes::Mesh;
use crate::sides::{Answer, CHUNK, Run, deal};
use glam::{Mat3, Vec3};
use outcrop::math::Ray;
use std::sync::Arc;

struct Embree {
    scene: Scene,
    mesh_bytes: u64,
    normals: Normals,
}

/// Qualities are Embree's; "compact" is its medium quality with the flag of that name.
fn options(quality: &str, threads: usize) -> Options {
    let number = ["low", "medium", "high"].iter().position(|q| *q == quality).unwrap_or(1);
    Options { quality: number as i32, is_compact: quality == "compact", threads }
}

pub fn build(mesh: &Arc<Mesh>, quality: &str, threads: usize) -> Option<Box<dyn Peer>> {
    peer(Scene::new(mesh, options(quality, threads)), mesh.bytes(), Normals::default())
}

/// A scene of two levels: a scene for each mesh, and one of their instances.
pub fn build_placed(placed: &Placed, quality: &str, threads: usize) -> Option<Box<dyn Peer>> {
    let turns = placed.places.iter().map(|place| place.world_from_mesh.matrix3.inverse().transpose().as_mat3());
    peer(Scene::of_placed(placed, options(quality, threads)), placed.bytes(), Normals(turns.collect()))
}

/// A scene of grids.
pub fn build_grids(grids: Grids, threads: usize) -> Option<Box<dyn Peer>> {
    let bytes = grids.bytes();
    peer(Scene::of_grids(grids, options("medium", threads)), bytes, Normals::default())
}

/// A scene of a cage with `rate` segments along each side of a face.
pub fn build_cage(cage: Cage, rate: f32, threads: usize) -> Option<Box<dyn Peer>> {
    let bytes = cage.bytes();
    peer(Scene::of_cage(cage, rate, options("medium", threads)), bytes, Normals::default())
}

fn peer(scene: Result<Scene, String>, mesh_bytes: u64, normals: Normals) -> Option<Box<dyn Peer>> {
    match scene {
        Ok(scene) => Some(Box::new(Embree { scene, mesh_bytes, normals })),
        Err(why) => {
            eprintln!("skipped: Embree ({why}; Debian's package is libembree-dev)");
            None
        }
    }
}

/// Turns the normals of instances, which Embree gives in the coordinates of the mesh, into the world, as outcrop gives
/// them.
#[derive(Default)]
struct Normals(Vec<Mat3>);

impl Normals {
    /// How directly a surface faces a ray.
    fn facing(&self, normal: [f32; 3], instance: u32, dir: [f32; 3]) -> f64 {
        let normal = Vec3::from(normal);
        let turned = self.0.get(instance as usize).map_or(normal, |turn| *turn * normal);
        f64::from(turned.normalize_or_zero().dot(dir.into()).abs())
    }
}

impl Peer for Embree {
    fn version(&self) -> String {
        format!("Embree {}", self.scene.version())
    }

    fn bytes(&self) -> u64 {
        self.scene.bytes() + self.mesh_bytes
    }

    fn calls(&self, _: &Batch) -> Vec<&'static str> {
        vec!["1", "4", "8", "16", "1M"]
    }

    fn ready<'a>(&'a self, call: &str, batch: &Batch, rays: &[Ray]) -> Box<dyn Run + 'a> {
        let (is_coherent, is_any) = (batch.is_coherent(), batch.is_any());
        let asked = Asked { scene: &self.scene, normals: &self.normals, is_coherent, is_any, rays: rays.to_vec() };
        match call {
            "4" => Box::new(Packets::<4> { asked, shadows: Vec::new(), hits: Vec::new() }),
            "8" => Box::new(Packets::<8> { asked, shadows: Vec::new(), hits: Vec::new() }),
            "16" => Box::new(Packets::<16> { asked, shadows: Vec::new(), hits: Vec::new() }),
            _ => Box::new(Singles { asked, is_stream: call == "1M", shadows: Vec::new(), hits: Vec::new() }),
        }
    }
}

struct Asked<'a> {
    scene: &'a Scene,
    normals: &'a Normals,
    is_coherent: bool,
    is_any: bool,
    rays: Vec<Ray>,
}

impl Asked<'_> {
    /// Shadow rays into two levels go as incoherent ones: of coherent ones `rtcOccluded16` of Embree 3.13.5 does not
    /// return there (the scene `station`, AVX-512: no end in ten minutes).
    fn context(&self) -> Context {
        let is_of_two_levels = !self.normals.0.is_empty();
        Context::new(self.is_coherent && !(self.is_any && is_of_two_levels))
    }
}

fn rtc_ray(ray: &Ray) -> RtcRay {
    RtcRay {
        org: ray.origin.as_vec3().to_array(),
        tnear: ray.t_min as f32,
        dir: ray.dir.to_array(),
        tfar: ray.t_max as f32,
        mask: u32::MAX,
        ..RtcRay::default()
    }
}

/// Embree marks a blocked ray with minus infinity.
fn is_blocked(tfar: f32) -> bool {
    tfar < 0.0
}

fn closest(geometry: u32, tfar: f32) -> Answer {
    if geometry == NONE { Answer::MISS } else { Answer { t: f64::from(tfar) } }
}

fn any(tfar: f32) -> Answer {
    if is_blocked(tfar) { Answer { t: 0.0 } } else { Answer::MISS }
}

struct Singles<'a> {
    asked: Asked<'a>,
    is_stream: bool,
    shadows: Vec<RtcRay>,
    hits: Vec<RtcRayHit>,
}

impl Run for Singles<'_> {
    fn prepare(&mut self) {
        let rays = self.asked.rays.iter().map(rtc_ray);
        if self.asked.is_any {
            self.shadows = rays.collect();
        } else {
            let hit = RtcHit { prim: NONE, geometry: NONE, instance: NONE, ..RtcHit::default() };
            self.hits = rays.map(|ray| RtcRayHit { ray, hit }).collect();
        }
    }

    fn run(&mut self, threads: usize) -> f64 {
        let (asked, is_stream) = (&self.asked, self.is_stream);
        let context = || asked.context();
        if asked.is_any {
            return deal(threads, self.shadows.chunks_mut(CHUNK), context, |context, rays| {
                let call = if is_stream { Scene::occluded_stream } else { Scene::occluded };
                call(asked.scene, context, rays);
                rays.iter().map(|ray| f64::from(u8::from(is_blocked(ray.tfar)))).sum()
            });
        }
        deal(threads, self.hits.chunks_mut(CHUNK), context, |context, rays| {
            let call = if is_stream { Scene::intersect_stream } else { Scene::intersect };
            call(asked.scene, context, rays);
            rays.iter()
                .filter(|r| r.hit.geometry != NONE)
                .map(|r| asked.normals.facing(r.hit.normal, r.hit.instance, r.ray.dir))
                .sum()
        })
    }

    fn answers(&self) -> Vec<Answer> {
        if self.asked.is_any {
            return self.shadows.iter().map(|ray| any(ray.tfar)).collect();
        }
        self.hits.iter().map(|r| closest(r.hit.geometry, r.ray.tfar)).collect()
    }
}

struct Packets<'a, const N: usize> {
    asked: Asked<'a>,
    shadows: Vec<RtcRays<N>>,
    hits: Vec<RtcRayHits<N>>,
}

/// The rays of a packet; what is beyond the last one repeats it, and is not valid.
fn packet<const N: usize>(rays: &[Ray]) -> RtcRays<N> {
    let lanes: [RtcRay; N] = std::array::from_fn(|i| rtc_ray(&rays[i.min(rays.len() - 1)]));
    RtcRays {
        org: std::array::from_fn(|axis| lanes.map(|ray| ray.org[axis])),
        tnear: lanes.map(|ray| ray.tnear),
        dir: std::array::from_fn(|axis| lanes.map(|ray| ray.dir[axis])),
        time: [0.0; N],
        tfar: lanes.map(|ray| ray.tfar),
        mask: [u32::MAX; N],
        id: [0; N],
        flags: [0; N],
    }
}

const fn nothing<const N: usize>() -> RtcHits<N> {
    RtcHits { normal: [[0.0; N]; 3], uv: [[0.0; N]; 2], prim: [NONE; N], geometry: [NONE; N], instance: [NONE; N] }
}

impl<const N: usize> Packets<'_, N> {
    /// How many rays of packet `i` there are.
    fn rays_of(count: usize, i: usize) -> usize {
        (count - i * N).min(N)
    }

    fn valid(rays: usize) -> Valid<N> {
        Valid(std::array::from_fn(|i| if i < rays { -1 } else { 0 }))
    }
}

impl<const N: usize> Run for Packets<'_, N> {
    fn prepare(&mut self) {
        let packets = self.asked.rays.chunks(N).map(packet);
        if self.asked.is_any {
            self.shadows = packets.collect();
        } else {
            self.hits = packets.map(|rays| RtcRayHits { rays, hits: nothing() }).collect();
        }
    }

    fn run(&mut self, threads: usize) -> f64 {
        let (asked, count) = (&self.asked, self.asked.rays.len());
        let context = || asked.context();
        if asked.is_any {
            let chunks = self.shadows.chunks_mut(CHUNK / N).enumerate();
            return deal(threads, chunks, context, |context, (chunk, packets)| {
                let mut sum = 0.0;
                for (i, rays) in packets.iter_mut().enumerate() {
                    let lanes = Self::rays_of(count, chunk * (CHUNK / N) + i);
                    asked.scene.occluded_packet(context, &Self::valid(lanes), rays);
                    sum += rays.tfar[..lanes].iter().filter(|t| is_blocked(**t)).count() as f64;
                }
                sum
            });
        }
        let chunks = self.hits.chunks_mut(CHUNK / N).enumerate();
        deal(threads, chunks, context, |context, (chunk, packets)| {
            let mut sum = 0.0;
            for (i, rays) in packets.iter_mut().enumerate() {
                let lanes = Self::rays_of(count, chunk * (CHUNK / N) + i);
                asked.scene.intersect_packet(context, &Self::valid(lanes), rays);
                let met = (0..lanes).filter(|&k| rays.hits.geometry[k] != NONE);
                let facing = |k: usize| {
                    asked.normals.facing(
                        rays.hits.normal.map(|n| n[k]),
                        rays.hits.instance[k],
                        rays.rays.dir.map(|d| d[k]),
                    )
                };
                sum += met.map(facing).sum::<f64>();
            }
            sum
        })
    }

    fn answers(&self) -> Vec<Answer> {
        let count = self.asked.rays.len();
        if self.asked.is_any {
            return self.shadows.iter().flat_map(|packet| packet.tfar.map(any)).take(count).collect();
        }
        let answers =
            |p: &RtcRayHits<N>| -> [Answer; N] { std::array::from_fn(|k| closest(p.hits.geometry[k], p.rays.tfar[k])) };
        self.hits.iter().flat_map(answers).take(count).collect()
    }
}
