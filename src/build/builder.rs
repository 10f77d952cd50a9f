//! The builder, which collects input and then writes the model file.

use super::edges::Edges;
use super::parts::Assembly;
use super::report::{BuildReport, PhaseSeconds};
use super::seal::{self, Asked, Gathered};
use super::shares::Shares;
use super::spool::Spool;
use super::surfaces::{OwnedCage, OwnedNurbs, Shape, Surface};
use super::values::Value;
use super::{BuildOptions, MOST_PROXY_RAYS, Splits, normals};
use crate::base::account::Account;
use crate::base::error::{Error, Result};
use crate::base::inputs::Inputs;
use crate::base::memory;
use crate::base::progress::{Cancel, Phase, Progress};
use crate::base::quota::Quota;
use crate::base::reserve;
use crate::base::scratch::{Scratch, ScratchSpace};
use crate::base::threads;
use crate::import::surfaces::{CageMesh, Heights, NurbsMesh};
use crate::import::{
    self, Attributes, Dicing, MaterialDesc, MaterialKey, MeshKey, PartDesc, PartKey, ReadOptions, Sink, UpAxis,
};
use crate::math::srgb;
use crate::store::{InstanceRow, MaterialRow, PartRow, TreeRow, sections};
use crate::structure::Par;
use crate::structure::bake::surfaces;
use glam::{DAffine3, DVec3};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::Ordering::Relaxed;
use std::time::Instant;

/// Fraction of the progress that reading takes.
const READ_SHARE: f64 = 0.4;

/// A model that is being built. Callers feed it through [`Sink`] or [`Builder::add_file`], and then call
/// [`Builder::finish`].
///
/// One thread at a time may use it. Other threads may observe it through the [`Progress`] and stop it through the
/// [`Cancel`].
pub struct Builder {
    options: BuildOptions,
    progress: Arc<Progress>,
    cancel: Cancel,
    begun: Instant,
    shares: Shares,
    space: Arc<ScratchSpace>,
    /// Memory of parts, names, materials and instances.
    account: Account,
    declared: Declared,
    /// The files that were read.
    inputs: Inputs,
    quota: Quota,
    meshes: Vec<Spool>,
    /// Surfaces with trees of their own.
    surfaces: Vec<Surface>,
    /// Primitive ids of these.
    faces: u32,
    /// The heights of the last surface that has some.
    heights: Option<Arc<Heights>>,
    /// Scratch file of the meshes that did not fit memory.
    spilled: Option<Scratch>,
    /// Number of bytes of the meshes in memory.
    in_memory: u64,
    assembly: Assembly,
    triangles_in: u64,
    non_finite: u64,
    unusable_normals: u64,
    metres_per_unit: Option<f64>,
    up: UpAxis,
    notes: Vec<String>,
}

impl Builder {
    /// An empty builder. Fails with `BadArgument` if an option is out of its range, and with `OverBudget`, which names
    /// the least budget, if no model can be built in the allowed memory.
    pub fn new(options: BuildOptions, progress: Arc<Progress>, cancel: Cancel) -> Result<Self> {
        if let Some(m) = options.metres_per_unit
            && !(m.is_finite() && m > 0.0)
        {
            return Err(Error::bad_argument("metres_per_unit must be finite and greater than 0"));
        }
        if !(options.crease_angle.is_finite() && options.crease_angle <= 180.0) {
            return Err(Error::bad_argument("crease_angle must be finite and at most 180"));
        }
        threads::check(options.threads, "threads")?;
        options.dicing.map_or(Ok(()), |dicing| dicing.check())?;
        if options.displacement.as_ref().is_some_and(|map| !map.scale.is_finite()) {
            return Err(Error::bad_argument("the scale of the displacement must be finite"));
        }
        if !(0.0..=180.0).contains(&options.surface_flat) {
            return Err(Error::bad_argument("surface_flat must be from 0 to 180 degrees"));
        }
        if options.proxy_rays > MOST_PROXY_RAYS {
            return Err(Error::bad_argument(format!("proxy_rays must be at most {MOST_PROXY_RAYS}")));
        }
        let default = MaterialDesc::default();
        let shares = Shares::of(options.memory_budget)?;
        let quota = Quota::new(options.max_bytes);
        let space = ScratchSpace::limited(options.temp_dir.as_deref(), quota.clone());
        Ok(Self {
            shares,
            space,
            account: Account::new(options.memory_budget),
            declared: Declared { materials: 1, meshes: 1, ..Declared::default() },
            inputs: Inputs::default(),
            quota,
            options,
            progress,
            cancel,
            begun: Instant::now(),
            meshes: vec![Spool::new(0)],
            surfaces: Vec::new(),
            faces: 0,
            heights: None,
            spilled: None,
            in_memory: 0,
            assembly: Assembly { materials: vec![row_of(default)], ..Assembly::default() },
            triangles_in: 0,
            non_finite: 0,
            unusable_normals: 0,
            metres_per_unit: None,
            up: UpAxis::Unknown,
            notes: Vec::new(),
        })
    }

    /// Reads a mesh file into the model. Errors are those of [`import::read_file`].
    pub fn add_file(&mut self, path: &Path) -> Result<()> {
        self.add_files(&[path])
    }

    /// Reads mesh files into the model, one after the other. The progress covers all of them. Errors are those of
    /// [`import::read_file`].
    pub fn add_files(&mut self, paths: &[impl AsRef<Path>]) -> Result<()> {
        self.progress.enter(Phase::Read);
        let options = ReadOptions {
            temp_dir: self.options.temp_dir.clone(),
            memory: self.shares.reader,
            textures: self.shares.textures,
            subdivide: self.options.subdivide,
            displacement: self.options.displacement.clone(),
            access: self.options.access.clone(),
            inputs: self.inputs.clone(),
            quota: self.quota.clone(),
            account: self.account.clone(),
        };
        import::read_files(paths, &options, self)
    }

    /// Number of triangles so far, dropped ones included.
    pub fn triangles_read(&self) -> u64 {
        self.triangles_in
    }

    /// Builds the trees and writes the file. On any error `out` is unchanged, and no scratch file is left.
    ///
    /// Fails with `Cancelled`, `Io`, `NoMemory`, `OverLimit`, or `BadArgument` if parts and instances contradict each
    /// other or if `out` is a file that was read.
    pub fn finish(mut self, out: &Path) -> Result<BuildReport> {
        let read = self.begun.elapsed().as_secs_f64();
        self.cancel.check()?;
        self.check_tables()?;
        self.leave_out_unplaced();
        let largest = self.meshes.iter().map(|mesh| mesh.triangles).max().unwrap_or(0);
        see_room(largest, self.in_memory, self.options.memory_budget)?;
        let shares = self.present_shares()?;
        let unusable = self.unusable_normals;
        if unusable > 0 {
            self.notes.push(format!(
                "{unusable} normals of the input are zero or not finite: the normals of their triangles replace them"
            ));
        }
        let Self {
            options, progress, cancel, notes, meshes, surfaces, spilled, assembly, space, inputs, quota, ..
        } = self;
        let gathered = Gathered {
            meshes,
            surfaces,
            spilled,
            assembly,
            triangles_in: self.triangles_in,
            non_finite: self.non_finite,
            metres_per_unit: options.metres_per_unit.or(self.metres_per_unit).unwrap_or(0.0),
            up: options.up.unwrap_or(self.up),
        };
        let (options, progress, cancel) = (&options, &progress, &cancel);
        // Pushed triangles took no part of the progress, which then is that of the other passes.
        let done = if progress.fraction() > 0.0 { READ_SHARE } else { 0.0 };
        let asked = Asked { options, shares, space, out, inputs, quota, progress, cancel, done };
        let mut report = in_pool(options.threads, |threads| seal::run(gathered, &asked, threads))?;
        progress.advance(1.0);
        progress.enter(Phase::Done);
        report.notes.splice(0..0, notes);
        report.unusable_normals = unusable;
        report.seconds = PhaseSeconds { read, ..report.seconds };
        Ok(report)
    }

    /// Counts the memory of a row of a table. Returns `false` if it does not fit. Then all tables are dropped, and the
    /// rest of the input is only counted, so that the error can name the memory that it needs.
    fn has_room(&mut self, bytes: u64) -> bool {
        self.account.add(bytes);
        if !self.declared.do_not_fit && !self.account.fits() {
            self.declared.do_not_fit = true;
            self.assembly = Assembly { materials: self.assembly.materials[..1].to_vec(), ..Assembly::default() };
            (self.meshes, self.in_memory) = (vec![Spool::new(0)], 0);
            self.surfaces.clear();
        }
        !self.declared.do_not_fit
    }

    /// Fails with `OverBudget` if the tables did not fit.
    fn check_tables(&self) -> Result<()> {
        let Declared { parts, materials, meshes, instances, do_not_fit } = self.declared;
        if !do_not_fit {
            return Ok(());
        }
        let what = format!(
            "a model with {parts} parts, {materials} materials, {meshes} meshes and {instances} instances of them"
        );
        Err(self.account.over(0, what))
    }

    /// The shares of the memory that the tables leave.
    fn present_shares(&self) -> Result<Shares> {
        Shares::of(self.account.rest())
    }

    /// Keeps a surface until its tree is built.
    fn surface(&mut self, mesh: MeshKey, shape: Shape) -> Result<()> {
        self.cancel.check()?;
        let limit = match self.meshes.get(mesh.0 as usize) {
            _ if self.declared.do_not_fit => return Ok(()),
            Some(_) if mesh == MeshKey::DIRECT => self.declared.parts,
            Some(spool) => spool.local_parts,
            None => return Err(Error::bad_argument("surface: no such mesh")),
        };
        if shape.parts().iter().any(|part| *part >= limit) {
            return Err(Error::bad_argument("surface: no such part"));
        }
        let faces = shape.faces();
        let Some(next) = self.faces.checked_add(faces).filter(|next| *next < u32::MAX) else {
            return Err(Error::bad_argument("surface: a model must have fewer than 2^32 - 1 faces"));
        };
        // Its bytes, those of its tree's row, and what is known of its faces while it is built.
        if self.has_room(shape.bytes() + 3 * size_of::<TreeRow>() as u64 + 256 * u64::from(faces)) {
            self.surfaces.push(Surface { mesh: mesh.0, first_face: self.faces, shape });
        }
        self.faces = next;
        self.progress.enter(Phase::Read);
        Ok(())
    }

    /// Drops shared meshes without instances, which can never be visible, and adds a note about them.
    fn leave_out_unplaced(&mut self) {
        let mut is_placed = vec![false; self.meshes.len()];
        is_placed[0] = true;
        self.assembly.instances.iter().for_each(|instance| is_placed[instance.tree as usize] = true);
        let (mut meshes, mut triangles) = (0, 0);
        for (_, mesh) in self.meshes.iter_mut().enumerate().filter(|(i, _)| !is_placed[*i]) {
            (meshes, triangles) = (meshes + u64::from(mesh.triangles > 0), triangles + mesh.triangles);
            self.in_memory -= mesh.bytes();
            *mesh = Spool::new(0);
        }
        self.surfaces.retain(|surface| is_placed[surface.mesh as usize]);
        if meshes > 0 {
            self.notes
                .push(format!("{meshes} shared meshes have no instances: their {triangles} triangles were left out"));
        }
    }

    /// Moves all triangles to a scratch file once they exceed their share of memory.
    fn spill(&mut self) -> Result<()> {
        if self.in_memory <= self.shares.spool && self.in_memory <= self.present_shares()?.spool {
            return Ok(());
        }
        let Self { options, cancel, meshes, spilled, space, .. } = self;
        let file = match spilled.take() {
            Some(file) => file,
            None => space.file()?,
        };
        let file = &*spilled.insert(file);
        in_pool(options.threads, |threads| {
            let par = Par { threads };
            meshes.iter_mut().try_for_each(|mesh| {
                cancel.check()?;
                mesh.spill(file, &par)
            })
        })?;
        self.in_memory = 0;
        Ok(())
    }
}

/// Numbers of the objects that were declared.
#[derive(Debug, Clone, Copy, Default)]
struct Declared {
    parts: u32,
    materials: u32,
    meshes: u32,
    instances: u64,
    /// True if their tables do not fit the memory budget. Then they are only counted.
    do_not_fit: bool,
}

/// Number of bytes of a part without its name: its row, its edges, its counts while a tree is built, and what the
/// allocator adds.
const PART_BYTES: u64 = (size_of::<PartRow>() * 9 / 8 + 2 * size_of::<Edges>() + 96) as u64;

/// Number of bytes of a shared mesh without triangles: the spool, and the row of its tree.
const MESH_BYTES: u64 = (size_of::<Spool>() + 3 * size_of::<TreeRow>()) as u64;

/// Makes room for another row. A large table grows by an eighth, so that little of its memory is unused.
fn reserve(rows: &mut Vec<PartRow>) {
    if rows.len() == rows.capacity() {
        rows.reserve_exact((rows.len() / 8).max(64));
    }
}

/// Tests that the system has the memory that a tree of this number of triangles mostly takes in addition to the
/// `in_memory` bytes of input, by allocating and freeing it: later, the memory would be missed by code that cannot
/// return an error. Trees are built one after the other. The test covers at most three quarters of the rest of the
/// budget (0: no limit), which other things also need. (A build of a million triangles from memory held 75 bytes per
/// triangle in addition to the 44 of the input.)
fn see_room(triangles: u64, in_memory: u64, budget: u64) -> Result<()> {
    let bytes = (16 << 20) + triangles.saturating_mul(64);
    let bytes = if budget == 0 { bytes } else { bytes.min(budget.saturating_sub(in_memory) / 4 * 3) };
    memory::room::<u8>(usize::try_from(bytes).unwrap_or(usize::MAX), &format!("a tree of {triangles} triangles"))
        .map(drop)
}

/// Runs `work` with the requested number of threads; with one, it runs in the calling thread only.
fn in_pool<T: Send>(threads: usize, work: impl FnOnce(usize) -> Result<T> + Send) -> Result<T> {
    let threads = if threads == 0 { threads::processors() } else { threads };
    if threads == 1 {
        return work(1);
    }
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).thread_name(|i| format!("outcrop-build-{i}"));
    let pool = pool.stack_size(threads::STACK);
    let pool = pool.build().map_err(|e| Error::io("build thread", "start", std::io::Error::other(e)))?;
    pool.install(|| work(threads))
}

fn row_of(m: MaterialDesc) -> MaterialRow {
    let MaterialDesc { colour, opacity, metalness, roughness } = m;
    MaterialRow { colour, opacity, metalness, roughness }.clamped()
}

impl Sink for Builder {
    fn units(&mut self, metres_per_unit: Option<f64>, up: UpAxis) {
        let usable = metres_per_unit.filter(|m| m.is_finite() && *m > 0.0);
        self.metres_per_unit = self.metres_per_unit.or(usable);
        if self.up == UpAxis::Unknown {
            self.up = up;
        }
    }

    fn material(&mut self, material: MaterialDesc) -> Result<MaterialKey> {
        let index = self.declared.materials;
        if index == u32::MAX {
            return Err(Error::bad_argument("material: there are too many materials"));
        }
        self.declared.materials += 1;
        if self.has_room(2 * size_of::<MaterialRow>() as u64) {
            self.assembly.materials.push(row_of(material));
        }
        Ok(index)
    }

    fn part(&mut self, part: PartDesc) -> Result<PartKey> {
        let index = self.declared.parts;
        if part.parent.is_some_and(|p| p >= index) {
            return Err(Error::bad_argument("part: the parent does not exist yet"));
        }
        let material = part.material.unwrap_or(0);
        if material >= self.declared.materials {
            return Err(Error::bad_argument("part: the material does not exist"));
        }
        if index >= u32::MAX - 1 {
            return Err(Error::bad_argument("part: there are too many parts"));
        }
        let id = part.id.unwrap_or(u64::from(index));
        let bounds = sections::EMPTY_BOUNDS;
        self.declared.parts += 1;
        if self.has_room(PART_BYTES + part.name.len() as u64) {
            let (name, parent) = (part.name, part.parent);
            reserve(&mut self.assembly.parts);
            self.assembly.parts.push(PartRow { id, name, parent, material, bounds, triangles: 0, flags: 0 });
        }
        Ok(index)
    }

    fn shared_mesh(&mut self, local_parts: u32) -> Result<MeshKey> {
        if local_parts == 0 || local_parts == u32::MAX {
            return Err(Error::bad_argument("shared mesh: the number of parts must be from 1 to 2^32 - 2"));
        }
        let index = self.declared.meshes;
        if index == u32::MAX {
            return Err(Error::bad_argument("shared mesh: there are too many meshes"));
        }
        self.declared.meshes += 1;
        if self.has_room(MESH_BYTES) {
            self.meshes.push(Spool::new(local_parts));
        }
        Ok(MeshKey(index))
    }

    fn triangles(
        &mut self,
        mesh: MeshKey,
        part: u32,
        positions: &[[DVec3; 3]],
        attributes: Attributes<'_>,
    ) -> Result<()> {
        if self.declared.do_not_fit {
            // The input is only counted, for the error at its end.
            return self.cancel.check();
        }
        let parts = self.declared.parts;
        let Some(spool) = self.meshes.get_mut(mesh.0 as usize) else {
            return Err(Error::bad_argument("triangles: no such mesh"));
        };
        let limit = if mesh == MeshKey::DIRECT { parts } else { spool.local_parts };
        if part >= limit {
            return Err(Error::bad_argument("triangles: no such part"));
        }
        attributes.check(positions.len())?;
        let most = self.options.max_triangles;
        if most > 0 && self.triangles_in + positions.len() as u64 > most {
            return Err(Error::OverLimit { what: "triangles of the input", most, limit: "max_triangles" });
        }
        if self.triangles_in + positions.len() as u64 >= u64::from(u32::MAX) {
            return Err(Error::bad_argument("triangles: a model must have fewer than 2^32 - 1 triangles"));
        }
        let before = spool.bytes();
        let pushed = positions.iter().enumerate().try_for_each(|(i, corners)| {
            let prim = (self.triangles_in + i as u64) as u32;
            if !corners.iter().all(|c| c.is_finite()) {
                self.non_finite += 1;
                return Ok(());
            }
            let colours = attributes.colours.map(|c| {
                c[i].map(|colour| {
                    let [r, g, b] = colour.map(srgb::level);
                    [r, g, b, 255]
                })
            });
            let normals = attributes.normals.map(|n| n[i].map(normals::given));
            let given = normals.iter().flatten();
            self.unusable_normals += given.filter(|n| **n == normals::OWN).count() as u64;
            spool.push(corners, part, prim, Value { colours, normals })
        });
        self.in_memory += spool.bytes() - before;
        self.triangles_in += positions.len() as u64;
        self.progress.enter(Phase::Read);
        self.progress.triangles.store(self.triangles_in, Relaxed);
        pushed?;
        reserve::check()?;
        self.spill()
    }

    fn dicing(&self) -> Option<Dicing> {
        self.options.dicing
    }

    fn cage(&mut self, mesh: MeshKey, cage: &CageMesh<'_>) -> Result<()> {
        if self.options.structure == surfaces::STRUCTURE {
            let owned = OwnedCage::of(cage, &mut self.heights)?;
            return self.surface(mesh, Shape::Cage(owned));
        }
        let (dicing, cancel) = (self.dicing(), self.cancel.clone());
        cage.dice(dicing, &cancel, &mut |part, micro| {
            self.triangles(mesh, part, &micro.positions, Attributes::normals(&micro.normals))
        })
    }

    fn nurbs(&mut self, mesh: MeshKey, surface: &NurbsMesh<'_>) -> Result<()> {
        if self.options.structure == surfaces::STRUCTURE {
            return self.surface(mesh, Shape::Nurbs(OwnedNurbs::of(surface)?));
        }
        let (dicing, cancel) = (self.dicing(), self.cancel.clone());
        surface.dice(dicing, &cancel, &mut |part, micro| {
            self.triangles(mesh, part, &micro.positions, Attributes::normals(&micro.normals))
        })
    }

    fn instance(&mut self, mesh: MeshKey, world_from_mesh: DAffine3, first_part: PartKey) -> Result<()> {
        self.declared.instances += 1;
        if !self.has_room(2 * size_of::<InstanceRow>() as u64) {
            return self.cancel.check();
        }
        let spool = self.meshes.get(mesh.0 as usize).filter(|_| mesh != MeshKey::DIRECT);
        let spool = spool.ok_or_else(|| Error::bad_argument("instance: no such shared mesh"))?;
        if u64::from(first_part) + u64::from(spool.local_parts) > u64::from(self.declared.parts) {
            return Err(Error::bad_argument("instance: the parts do not exist"));
        }
        let columns = world_from_mesh.to_cols_array();
        if !sections::is_invertible(&columns) {
            return Err(Error::bad_argument("instance: the transform is not finite or not invertible"));
        }
        self.assembly.instances.push(InstanceRow { tree: mesh.0, first_part, world_from_mesh: columns });
        Ok(())
    }

    fn at(&mut self, bytes: u64, total: u64) {
        self.progress.bytes_read.fetch_max(bytes, Relaxed);
        if total > 0 {
            self.progress.advance(READ_SHARE * bytes as f64 / total as f64);
        }
    }

    fn note(&mut self, text: String) {
        self.notes.push(text);
    }

    fn cancel(&self) -> &Cancel {
        &self.cancel
    }
}

impl std::fmt::Debug for Builder {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Builder").field("triangles_in", &self.triangles_in).finish_non_exhaustive()
    }
}

/// True or false if the caller decides on splits, `None` if the shape of the triangles decides.
pub(super) fn asked_for_splits(splits: Splits) -> Option<bool> {
    match splits {
        Splits::Auto => None,
        Splits::Off => Some(false),
        Splits::On => Some(true),
    }
}
