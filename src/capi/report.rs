//! The end of a build, and its report.

use super::build::Input;
use super::guard::{Fill, Sized32, bad, boundary, out};
use super::handles::{self, Shell};
use super::job::{JobObject, oc_job, product};
use super::status::oc_status;
use crate::base::error::Result;
use crate::build::BuildReport;
use std::ffi::{CString, c_char};
use std::path::PathBuf;
use std::sync::Arc;

/// Result of a build job.
#[derive(Clone)]
pub(super) struct Built {
    pub(super) report: BuildReport,
    notes: Arc<[CString]>,
}

/// Reads the files and builds the model.
pub(super) fn run(input: Input, out: PathBuf) -> Result<Built> {
    let Input { mut builder, files, .. } = input;
    builder.add_files(&files)?;
    let report = builder.finish(&out)?;
    let note = |n: &String| CString::new(n.replace('\0', "")).unwrap_or_default();
    let notes = report.notes.iter().map(note).collect();
    Ok(Built { report, notes })
}

/// Statistics of a build.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct oc_build_report {
    /// Size of this struct in bytes; OC_INIT sets it.
    pub struct_size: u32,
    /// Number of notes; oc_job_build_note returns them.
    pub notes: u32,
    /// Triangles in the input.
    pub triangles_in: u64,
    /// Triangles in the model.
    pub triangles_kept: u64,
    /// Triangles dropped because a corner is NaN or infinite.
    pub dropped_non_finite: u64,
    /// Triangles dropped because they have no area.
    pub dropped_degenerate: u64,
    /// Triangles dropped because a corner is more than 1e15 units from the origin of its mesh.
    pub dropped_out_of_range: u64,
    /// Number of parts.
    pub parts: u64,
    /// Number of placed instances of shared meshes.
    pub instances: u64,
    /// Bytes that the geometry takes in memory when all of it is loaded.
    pub geometry_bytes: u64,
    /// Size of the model file in bytes.
    pub file_bytes: u64,
    /// Seconds spent on reading input.
    pub seconds_read: f64,
    /// Seconds spent on building.
    pub seconds_build: f64,
    /// Seconds spent on writing.
    pub seconds_write: f64,
    /// Greatest distance between a corner of the input and the stored corner, in units of the model.
    pub position_error: f64,
    /// Normals of the input that are zero, NaN or infinite. The normals of their triangles replace them.
    pub unusable_normals: u64,
}

// SAFETY: `repr(C)`, numbers without padding, `struct_size` first.
unsafe impl Sized32 for oc_build_report {
    const NAME: &'static str = "oc_build_report";
    const FIRST_SIZE: usize = std::mem::offset_of!(oc_build_report, position_error);
}

/// Returns the statistics of a finished build.
///
/// - `job`: a job of oc_build_start.
/// - `out_report`: receives the statistics. Initialise it with OC_INIT.
///
/// Errors:
/// - OC_STATUS_INVALID_STATE: the build is not done, or failed.
/// - OC_STATUS_INVALID_STATE or OC_STATUS_INVALID_ARGUMENT: the job is of another kind.
///
/// Thread safety: any thread. Cheap.
/// # Safety
/// `job` is a live handle; `out_report` is initialised.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_job_build_report(job: *const oc_job, out_report: *mut oc_build_report) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        let fill = Fill::new(out_report)?;
        handles::with(job, |job: &Shell<JobObject>| {
            let Built { report: r, notes } = product::<Built>(job, "report")?;
            fill.with(oc_build_report {
                struct_size: 0,
                notes: notes.len() as u32,
                triangles_in: r.triangles_in,
                triangles_kept: r.triangles_kept,
                dropped_non_finite: r.non_finite,
                dropped_degenerate: r.degenerate,
                dropped_out_of_range: r.out_of_range,
                parts: r.parts,
                instances: r.instances,
                geometry_bytes: r.bytes_trace,
                file_bytes: r.bytes,
                seconds_read: r.seconds.read,
                seconds_build: r.seconds.build,
                seconds_write: r.seconds.write,
                position_error: r.position_error,
                unusable_normals: r.unusable_normals,
            });
            Ok(())
        })
    })
}

/// Returns a note of a finished build: a warning about an input that could be read nevertheless.
///
/// - `job`: a job of oc_build_start.
/// - `index`: number of the note, below `notes` of oc_build_report.
/// - `out_text`: receives the text.
///
/// Errors: as for oc_job_build_report. OC_STATUS_INVALID_ARGUMENT also if `index` is out of range.
///
/// Ownership: the job owns the string. It is valid as long as the job.
/// Thread safety: any thread. Cheap.
/// # Safety
/// `job` is a live handle; `out_text` is writable.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_job_build_note(job: *const oc_job, index: u32, out_text: *mut *const c_char) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        let out = out(out_text, "out_text")?;
        handles::with(job, |job: &Shell<JobObject>| {
            let built = product::<Built>(job, "report")?;
            let Some(note) = built.notes.get(index as usize) else {
                return bad(format!("note index {index} is out of range: the report has {} notes", built.notes.len()));
            };
            // The job keeps the list alive.
            out.write(note.as_ptr());
            Ok(())
        })
    })
}
