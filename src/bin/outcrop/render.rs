//! `outcrop render`.

use crate::common::{self, Failure, Outcome};
use crate::view::{self, ViewArgs};
use glam::DVec3;
use outcrop::base::error::Error;
use outcrop::base::progress::Cancel;
use outcrop::render::{Buffer, Frame, FrameOptions, FrameSettings, FrameState, FrameStatus, Mapped};
use outcrop::scene::{Background, Camera, Context, ContextOptions, Light, LightKind, Model};
use serde_json::{Value, json};
use std::io::Cursor;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Render a picture of a model as PNG
#[derive(clap::Args)]
pub struct Args {
    /// The model file
    #[arg(value_name = "MODEL.oc")]
    model: PathBuf,
    /// The picture to write
    #[arg(short, long, value_name = "OUT.png")]
    output: PathBuf,
    /// Pixels
    #[arg(long, value_name = "WxH", default_value = "1024x768", value_parser = common::size)]
    size: (u32, u32),
    #[command(flatten)]
    view: ViewArgs,
    /// A light, any number of times: "head", "sun:X,Y,Z" (shining along X,Y,Z), "point:X,Y,Z", each with
    /// "*INTENSITY" if that is not 1. By default a headlight and a sun from over the left shoulder
    #[arg(long = "light", value_name = "LIGHT", value_parser = light)]
    lights: Vec<Light>,
    /// No shadows
    #[arg(long)]
    no_shadows: bool,
    /// Rays a pixel
    #[arg(long, value_name = "N", default_value_t = 4, value_parser = clap::value_parser!(u32).range(1..=1024))]
    samples: u32,
    /// Pixels of error: the area, in pixels, that a stand-in may cover; 0 for exact answers
    #[arg(long, value_name = "P", default_value_t = 0.0)]
    poe: f32,
    /// The background's linear colour, in place of a gradient
    #[arg(long, value_name = "R,G,B", value_parser = common::point)]
    background: Option<DVec3>,
    /// Threads; 0 for all of the machine's
    #[arg(long, value_name = "N", default_value_t = 0)]
    threads: usize,
    /// Bytes of memory for models, with K, M, G or T; 0 for three quarters of the machine's
    #[arg(long, value_name = "BYTES", default_value = "0", value_parser = common::byte_size)]
    memory: u64,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

/// Parses a light.
fn light(text: &str) -> Result<Light, String> {
    let (what, intensity) = match text.rsplit_once('*') {
        Some((what, factor)) => (what, factor.parse().map_err(|_| format!("{factor:?} is no intensity"))?),
        None => (text, 1.0),
    };
    let kind = match what.split_once(':') {
        None if what == "head" => LightKind::Headlight,
        Some(("sun", direction)) => LightKind::Directional(common::point(direction)?),
        Some(("point", place)) => LightKind::Point(common::point(place)?),
        _ => return Err("wanted is head, sun:X,Y,Z or point:X,Y,Z".into()),
    };
    let light = Light { kind, colour: [1.0; 3], intensity, shadows: true };
    light.check().map_err(|e| e.to_string())?;
    Ok(light)
}

/// A headlight so that nothing is black, and a sun over the left shoulder that gives shape.
fn usual_lights(camera: &Camera) -> Vec<Light> {
    let (Camera::Perspective { eye, at, up, .. } | Camera::Orthographic { eye, at, up, .. }) = *camera;
    let forward = (at - eye).normalize_or(DVec3::X);
    let right = forward.cross(up).normalize_or(DVec3::Y);
    let sun = forward + right * 0.7 - right.cross(forward) * 0.9;
    let sun = Light { kind: LightKind::Directional(sun), colour: [1.0, 0.97, 0.92], intensity: 0.8, shadows: true };
    vec![Light { intensity: 0.35, ..Light::HEADLIGHT }, sun]
}

/// Runs the verb.
pub fn run(args: &Args) -> Outcome {
    let cancel = common::cancel_on_ctrl_c();
    let defaults = ContextOptions { memory_budget: args.memory, ..ContextOptions::default() };
    let threads = if args.threads == 0 { defaults.threads } else { args.threads };
    let context = Context::new(ContextOptions { threads, ..defaults })?;
    let begun = Instant::now();
    let model = Model::open(&context, &args.model)?;
    let seconds_open = begun.elapsed().as_secs_f64();
    let camera = args.view.camera(&model)?;
    let mut lights = if args.lights.is_empty() { usual_lights(&camera) } else { args.lights.clone() };
    if args.no_shadows {
        lights.iter_mut().for_each(|l| l.shadows = false);
    }
    let background = match args.background {
        Some(c) => Background::Colour([c.x as f32, c.y as f32, c.z as f32, 1.0]),
        None => Background::default(),
    };
    let scene = view::alone(&context, &model, lights, background)?;
    let (width, height) = args.size;
    let frame = Frame::new(&context, FrameOptions { width, height, ..FrameOptions::default() })?;
    let settings = FrameSettings { samples: args.samples, poe: args.poe, ..FrameSettings::default() };
    frame.request(&scene, &camera, &settings)?;
    let status = finished(&frame, &cancel)?;
    write_png(&frame.map(Buffer::ColourSrgb8)?, &args.output)?;
    let text = format!(
        "{}: {width}x{height}, opened in {seconds_open:.2} s, rendered in {:.2} s",
        args.output.display(),
        status.seconds
    );
    common::print(args.json, &as_json(args, &camera, seconds_open, &status), &text)
}

/// Waits for the picture, showing how far it is.
fn finished(frame: &Frame, cancel: &Cancel) -> Result<FrameStatus, Failure> {
    let bar = common::progress_bar(1000);
    bar.set_message("rendering");
    let status = loop {
        if cancel.is_cancelled() {
            frame.cancel();
        }
        let status = frame.wait(Duration::from_millis(100));
        if status.state != FrameState::Running {
            break status;
        }
        bar.set_position((status.fraction * 1000.0) as u64);
    };
    bar.finish_and_clear();
    match (status.state, &status.error) {
        (FrameState::Converged | FrameState::CompleteWithinBudget, _) => Ok(status),
        (FrameState::Cancelled, _) => Err(Error::Cancelled.into()),
        (_, Some(error)) => Err(Failure::Frame(error.to_string())),
        (state, None) => Err(Failure::Frame(format!("the frame ended as {state:?}"))),
    }
}

/// Writes a picture under a temporary name, then renames it.
fn write_png(picture: &Mapped, path: &Path) -> Outcome {
    let failed = |doing| move |e| Error::io(path, doing, e);
    let mut bytes = Cursor::new(Vec::new());
    image::write_buffer_with_format(
        &mut bytes,
        picture.bytes(),
        picture.width(),
        picture.height(),
        image::ExtendedColorType::Rgba8,
        image::ImageFormat::Png,
    )
    .map_err(|e| Error::Internal(format!("PNG: {e}")))?;
    let name = path.file_name().ok_or_else(|| Failure::Usage("the output has no file name".into()))?;
    let temporary = path.with_file_name(format!(".{}.{}.tmp", name.to_string_lossy(), std::process::id()));
    let written = std::fs::write(&temporary, bytes.into_inner()).map_err(failed("write"));
    let renamed = written.and_then(|()| std::fs::rename(&temporary, path).map_err(failed("rename")));
    if renamed.is_err() {
        let _ = std::fs::remove_file(&temporary);
    }
    Ok(renamed?)
}

fn as_json(args: &Args, camera: &Camera, seconds_open: f64, status: &FrameStatus) -> Value {
    let (Camera::Perspective { eye, at, up, .. } | Camera::Orthographic { eye, at, up, .. }) = camera;
    json!({
        "file": args.output.to_string_lossy(),
        "width": args.size.0,
        "height": args.size.1,
        "samples": args.samples,
        "eye": eye.to_array(),
        "at": at.to_array(),
        "up": up.to_array(),
        "pixels": {
            "exact": status.pixels_exact, "lod": status.pixels_lod, "missing": status.pixels_missing,
            "total": status.pixels_total,
        },
        "worst_error_px": status.worst_error_px,
        "bytes_resident": status.bytes_resident,
        "seconds": { "open": seconds_open, "render": status.seconds },
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lights_are_understood() {
        assert_eq!(light("head").unwrap().kind, LightKind::Headlight);
        let sun = light("sun:0,0,-1*0.5").unwrap();
        assert_eq!((sun.kind, sun.intensity), (LightKind::Directional(-DVec3::Z), 0.5));
        for bad in ["", "moon", "sun:0,0,0", "point:1,2", "head*-1", "head*x"] {
            assert!(light(bad).is_err(), "{bad}");
        }
    }
}
