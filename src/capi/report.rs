//! The end of a build, and what it did.

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

/// What a build leaves behind.
#[derive(Clone)]
pub(super) struct Built {
    pub(super) report: BuildReport,
    notes: Arc<[CString]>,
}

/// Reads the files and makes the model.
pub(super) fn run(input: Input, out: PathBuf) -> Result<Built> {
    let Input { mut builder, files, .. } = input;
    builder.add_files(&files)?;
    let report = builder.finish(&out)?;
    let note = |n: &String| CString::new(n.replace('\0', "")).unwrap_or_default();
    let notes = report.notes.iter().map(note).collect();
    Ok(Built { report, notes })
}

/// What a build did.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct oc_build_report {
    /// Set by OC_INIT.
    pub struct_size: u32,
    /// How many notes there are: see oc_job_build_note.
    pub notes: u32,
    /// Triangles in the input.
    pub triangles_in: u64,
    /// Triangles in the model.
    pub triangles_kept: u64,
    /// Left out: a corner is NaN or infinite.
    pub dropped_non_finite: u64,
    /// Left out: no area.
    pub dropped_degenerate: u64,
    /// Left out: too far away from the others to be told apart.
    pub dropped_out_of_range: u64,
    /// Parts.
    pub parts: u64,
    /// Shared meshes placed.
    pub instances: u64,
    /// Bytes of geometry in memory, once opened.
    pub geometry_bytes: u64,
    /// Bytes of the file.
    pub file_bytes: u64,
    /// Seconds of reading.
    pub seconds_read: f64,
    /// Seconds of building.
    pub seconds_build: f64,
    /// Seconds of writing.
    pub seconds_write: f64,
}

// SAFETY: `repr(C)`, numbers without padding, `struct_size` first.
unsafe impl Sized32 for oc_build_report {
    const NAME: &'static str = "oc_build_report";
}

/// What the build did whose job this is. OC_STATUS_INVALID_STATE before it is done, or if it failed; of a job of
/// another kind, that or OC_STATUS_INVALID_ARGUMENT.
///
/// Thread safety: any thread. Cheap.
/// # Safety
/// Live handle; `out_report` initialised.
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
            });
            Ok(())
        })
    })
}

/// Something that the user should know about an input, though it could be read; `index` below the report's `notes`.
///
/// `out_text` gets a string of the job's, valid as long as the job. Thread safety: any thread. Cheap.
/// # Safety
/// Live handle; `out_text` writable.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_job_build_note(job: *const oc_job, index: u32, out_text: *mut *const c_char) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        let out = out(out_text, "out_text")?;
        handles::with(job, |job: &Shell<JobObject>| {
            let built = product::<Built>(job, "report")?;
            let Some(note) = built.notes.get(index as usize) else {
                return bad(format!("note {index} of {}", built.notes.len()));
            };
            // The job keeps the list alive.
            out.write(note.as_ptr());
            Ok(())
        })
    })
}
