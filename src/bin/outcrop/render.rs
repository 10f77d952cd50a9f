//! `outcrop render`.

use crate::common::{self, Failure, Outcome};
use crate::occurrence;
use crate::output::Destination;
use crate::view::{PartArgs, Shown, ViewArgs};
use glam::DVec3;
use outcrop::base::error::Error;
use outcrop::base::output::{Medium, OutputFile, OutputStream};
use outcrop::base::progress::Cancel;
use outcrop::render::{Buffer, Frame, FrameOptions, FrameSettings, FrameState, FrameStatus, Mapped, Outputs};
use outcrop::scene::{Background, Camera, Context, ContextOptions, Light, LightKind};
use serde_json::{Value, json};
use std::io::Cursor;
use std::path::PathBuf;
use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};

/// Render a picture of a model or a scene as a PNG file
#[derive(clap::Args)]
pub struct Args {
    /// The model file or the scene file
    #[arg(value_name = "FILE.oc")]
    model: PathBuf,
    /// The picture to write: a regular file or a new one, and not the model. "-": standard output
    #[arg(short, long, value_name = "OUT.png")]
    output: PathBuf,
    /// Size of the picture in pixels
    #[arg(long, value_name = "WxH", default_value = "1024x768", value_parser = common::size)]
    size: (u32, u32),
    #[command(flatten)]
    view: ViewArgs,
    #[command(flatten)]
    parts: PartArgs,
    /// A light; may be given several times: "head", "sun:X,Y,Z" (shining along X,Y,Z) or "point:X,Y,Z", with
    /// "*INTENSITY" if that is not 1. Default: those of the scene; of a model or a scene without lights of its own a
    /// headlight, and a sun over the left shoulder
    #[arg(long = "light", value_name = "LIGHT", value_parser = light)]
    lights: Vec<Light>,
    /// Render without shadows
    #[arg(long)]
    no_shadows: bool,
    /// Rays per pixel
    #[arg(long, value_name = "N", default_value_t = 4, allow_negative_numbers = true, value_parser = clap::value_parser!(u32).range(1..=1024))]
    samples: u32,
    /// Pixels of error: the area, in square pixels, that a stand-in may cover; 0 for exact answers
    #[arg(long, value_name = "P", default_value_t = 0.0, allow_negative_numbers = true)]
    poe: f32,
    /// Linear colour of the background, instead of that of the scene; that of a model is a gradient
    #[arg(long, value_name = "R,G,B", value_parser = common::point, allow_hyphen_values = true)]
    background: Option<DVec3>,
    /// Factor to the light of surfaces; the background keeps its colour
    #[arg(long, value_name = "FACTOR", default_value_t = 1.0, allow_negative_numbers = true)]
    exposure: f32,
    /// Write the nearest level to each colour: highlights are not compressed, gradients not dithered
    #[arg(long)]
    exact_colours: bool,
    /// Number of threads; 0 for all of the machine
    #[arg(long, value_name = "N", default_value = "0", allow_negative_numbers = true, value_parser = common::threads)]
    threads: usize,
    /// Bytes of memory for models, with suffix K, M, G or T; may be less than the models need. 0: three quarters of the
    /// machine's memory
    #[arg(long, visible_alias = "memory", value_name = "BYTES", default_value = "0", allow_negative_numbers = true, value_parser = common::byte_size)]
    cache: u64,
    /// When to take the picture: "first", as soon as there is one; "complete", when it cannot get better; "converged",
    /// likewise, but fail if it is coarser than requested; or after a number of seconds
    #[arg(
        long,
        value_name = "first|complete|converged|SECONDS",
        default_value = "complete",
        allow_negative_numbers = true,
        value_parser = until
    )]
    until: Until,
    /// End with the picture whose data fits --cache at once. By default a picture that does not fit is completed part
    /// by part, which takes longer
    #[arg(long)]
    at_once: bool,
    /// Also print which place of which mesh the picture shows at a pixel, counted from the upper left corner: its
    /// number, the ids of the scenes around its instance and that of the instance, its map to the world, its part, and
    /// whether it is a triangle or a stand-in, with the error
    #[arg(long, value_name = "X,Y", value_parser = pixel)]
    occurrence: Option<(u32, u32)>,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

/// Parses a pixel.
fn pixel(text: &str) -> Result<(u32, u32), String> {
    let parsed = text.split_once(',').map(|(x, y)| (x.trim().parse(), y.trim().parse()));
    match parsed {
        Some((Ok(x), Ok(y))) => Ok((x, y)),
        _ => Err("expected two whole numbers X,Y".into()),
    }
}

/// Moment at which the picture is taken.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Until {
    First,
    Complete,
    Converged,
    Seconds(f64),
}

fn until(text: &str) -> Result<Until, String> {
    match text {
        "first" => Ok(Until::First),
        "complete" => Ok(Until::Complete),
        "converged" => Ok(Until::Converged),
        _ => match text.parse() {
            Ok(seconds) if (0.0..1e9).contains(&seconds) => Ok(Until::Seconds(seconds)),
            _ => Err("expected first, complete, converged or a number of seconds".into()),
        },
    }
}

impl Until {
    /// True if the picture with this `status` is taken.
    fn is_reached(self, status: &FrameStatus) -> bool {
        let is_whole = status.pictures > 0;
        match self {
            Until::First => is_whole,
            Until::Seconds(seconds) => is_whole && status.seconds >= seconds,
            Until::Complete | Until::Converged => false,
        }
    }
}

/// Parses a light.
fn light(text: &str) -> Result<Light, String> {
    let (what, intensity) = match text.rsplit_once('*') {
        Some((what, factor)) => (what, factor.parse().map_err(|_| format!("{factor:?} is not an intensity"))?),
        None => (text, 1.0),
    };
    let kind = match what.split_once(':') {
        None if what == "head" => LightKind::Headlight,
        Some(("sun", direction)) => LightKind::Directional(common::point(direction)?),
        Some(("point", place)) => LightKind::Point(common::point(place)?),
        _ => return Err("expected head, sun:X,Y,Z or point:X,Y,Z".into()),
    };
    let light = Light { kind, colour: [1.0; 3], intensity, shadows: true };
    light.check().map_err(|e| e.to_string())?;
    Ok(light)
}

/// Returns a headlight, so that nothing is black, and a sun over the left shoulder for shading.
fn usual_lights(camera: &Camera) -> Vec<Light> {
    let (Camera::Perspective { eye, at, up, .. } | Camera::Orthographic { eye, at, up, .. }) = *camera;
    let forward = (at - eye).normalize_or(DVec3::X);
    let right = forward.cross(up).normalize_or(DVec3::Y);
    let sun = forward + right * 0.7 - right.cross(forward) * 0.9;
    let sun = Light { kind: LightKind::Directional(sun), colour: [1.0, 0.97, 0.92], intensity: 0.7, shadows: true };
    vec![Light { intensity: 0.3, ..Light::HEADLIGHT }, sun]
}

/// Runs the command.
pub fn run(args: &Args) -> Outcome {
    let to = Destination::new(&args.output, "png", "a picture", &[&args.model], true)?;
    if let Some((x, y)) = args.occurrence.filter(|&(x, y)| x >= args.size.0 || y >= args.size.1) {
        let (width, height) = args.size;
        return Err(Error::bad_argument(format!("--occurrence {x},{y} is outside of {width}x{height} pixels")).into());
    }
    let cancel = common::cancel_on_ctrl_c();
    let defaults = ContextOptions { memory_budget: args.cache, ..ContextOptions::default() };
    let threads = if args.threads == 0 { defaults.threads } else { args.threads };
    let context = Context::new(ContextOptions { threads, ..defaults })?;
    let begun = Instant::now();
    let shown = Shown::open(&context, &args.model, &args.parts)?;
    let seconds_open = begun.elapsed().as_secs_f64();
    let (scene, before) = (&shown.scene, shown.scene.state());
    let camera = args.view.camera(&shown, args.size)?;
    let mut lights = match before.lights() {
        _ if !args.lights.is_empty() => args.lights.clone(),
        [Light::HEADLIGHT] => usual_lights(&camera),
        own => own.to_vec(),
    };
    if args.no_shadows {
        lights.iter_mut().for_each(|l| l.shadows = false);
    }
    let background = match args.background {
        Some(c) => Background::Colour([c.x as f32, c.y as f32, c.z as f32, 1.0]),
        None => before.background(),
    };
    scene.set_lights(lights)?;
    scene.set_background(background)?;
    scene.commit()?;
    let (width, height) = args.size;
    let outputs = if args.occurrence.is_some() { occurrence::OUTPUTS | Outputs::COLOUR } else { Outputs::COLOUR };
    let frame = Frame::new(&context, FrameOptions { width, height, outputs, ..FrameOptions::default() })?;
    let settings = FrameSettings {
        samples: args.samples,
        poe: args.poe,
        at_once: args.at_once,
        exposure: args.exposure,
        exact_colours: args.exact_colours,
        ..FrameSettings::default()
    };
    let first = Arc::new(OnceLock::new());
    let seen = Arc::clone(&first);
    frame.set_wake(Some(Arc::new(move || {
        let _ = seen.set(Instant::now());
    })));
    let asked = Instant::now();
    frame.request(&scene.state(), &camera, &settings)?;
    let status = taken(&frame, args.until, &cancel)?;
    if args.until == Until::Converged && status.state == FrameState::CompleteWithinBudget {
        let seconds = [seconds_open, status.seconds];
        if args.json {
            let mut value = as_json(args, &camera, seconds, &status);
            value["file"] = Value::Null;
            to.report(true, &value, "")?;
        }
        let why = why_coarser(&status);
        return Err(Failure::Frame(format!("the picture does not converge: {why}; no picture is written")));
    }
    if args.occurrence.is_some() {
        // No later picture comes between the colours and what is at the pixel.
        frame.cancel();
        while frame.wait(Duration::from_secs(1)).state == FrameState::Running {}
    }
    let picture = frame.map(Buffer::ColourSrgb8)?;
    frame.cancel();
    let seconds_first = first.get().map_or(status.seconds, |first| first.duration_since(asked).as_secs_f64());
    write_png(&picture, &to)?;
    let seconds = [seconds_open, seconds_first];
    let (mut value, mut text) = (as_json(args, &camera, seconds, &status), as_text(args, seconds, &status));
    if let Some(at) = args.occurrence {
        let (met, line) = occurrence::at_pixel(&frame, &scene.state(), at)?;
        value["occurrence"] = met;
        text = format!("{}\n{line}", text.trim_end());
    }
    to.report(args.json, &value, &text)
}

/// Returns the reason why a picture is coarser than requested. The missing bytes are known only for the threshold that
/// the budget allows, and are 0 if all of its data is in memory.
fn why_coarser(status: &FrameStatus) -> String {
    match (&status.error, status.bytes_wanted) {
        (Some(error), _) => error.to_string(),
        (None, 0) => {
            format!("the budget allows {:.2} pixels of error; a larger --cache allows less", status.effective_poe)
        }
        (None, bytes) => {
            let (poe, bytes) = (status.effective_poe, common::in_bytes(bytes));
            format!("the budget allows {poe:.2} pixels of error, {bytes} more are needed")
        }
    }
}

fn as_text(args: &Args, [open, first]: [f64; 2], status: &FrameStatus) -> String {
    let (width, height) = args.size;
    let mut text = format!(
        "{}: {width}x{height}, opened in {open:.2} s, first picture after {first:.2} s, this one after {:.2} s",
        args.output.display(),
        status.seconds
    );
    if status.state != FrameState::Converged || args.poe > 0.0 {
        let share = |pixels: u64| 100.0 * pixels as f64 / status.pixels_total.max(1) as f64;
        text += &format!(
            "\nerror {:.2} pixels on average, {:.1} at most; {:.1} % of the pixels exact, {:.1} % within the requested error, {:.1} % coarser",
            status.mean_error_px,
            status.worst_error_px,
            share(status.pixels_exact),
            share(status.pixels_lod),
            share(status.pixels_missing)
        );
    }
    if status.state == FrameState::CompleteWithinBudget {
        let poe = status.effective_poe;
        text += &format!("\ncoarser than requested: the budget allows {poe:.2} pixels of error");
    }
    text
}

/// Returns the name of a state in JSON.
fn name_of(state: FrameState) -> &'static str {
    match state {
        FrameState::Idle => "idle",
        FrameState::Running => "running",
        FrameState::Converged => "converged",
        FrameState::Cancelled => "cancelled",
        FrameState::Failed => "failed",
        FrameState::CompleteWithinBudget => "complete_within_budget",
    }
}

/// Waits for the picture and shows progress.
fn taken(frame: &Frame, until: Until, cancel: &Cancel) -> Result<FrameStatus, Failure> {
    let bar = common::progress_bar(1000);
    bar.set_message("rendering");
    let status = loop {
        if cancel.is_cancelled() {
            frame.cancel();
        }
        let pause = if matches!(until, Until::First | Until::Seconds(_)) { 1 } else { 100 };
        let status = frame.wait(Duration::from_millis(pause));
        if status.state != FrameState::Running || until.is_reached(&status) {
            break status;
        }
        bar.set_position((status.fraction * 1000.0) as u64);
    };
    bar.finish_and_clear();
    match (status.state, &status.error) {
        (FrameState::Converged | FrameState::CompleteWithinBudget | FrameState::Running, _) => Ok(status),
        (FrameState::Cancelled, _) => Err(Error::Cancelled.into()),
        (_, Some(error)) => Err(Failure::Frame(error.to_string())),
        (state, None) => Err(Failure::Frame(format!("the frame ended in the state {state:?}"))),
    }
}

/// Writes a picture as PNG.
fn write_png(picture: &Mapped, to: &Destination) -> Outcome {
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
    let mut out: Box<dyn Medium> = match to {
        Destination::File(path) => Box::new(OutputFile::create(path)?),
        Destination::Stdout => Box::new(OutputStream::new(std::io::stdout())?),
    };
    out.append(&bytes.into_inner())?;
    Ok(out.publish()?)
}

fn as_json(args: &Args, camera: &Camera, [open, first]: [f64; 2], status: &FrameStatus) -> Value {
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
        "state": name_of(status.state),
        "fraction": status.fraction,
        "pictures": status.pictures,
        "poe": args.poe,
        "effective_poe": status.effective_poe,
        "worst_error_px": status.worst_error_px,
        "mean_error_px": status.mean_error_px,
        "bytes_resident": status.bytes_resident,
        "bytes_wanted": status.bytes_wanted,
        "seconds_to_go": status.seconds_to_go.is_finite().then_some(status.seconds_to_go),
        "seconds": { "open": open, "first": first, "render": status.seconds },
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_of_until_are_parsed() {
        let words = ["first", "complete", "converged", "0", "2.5"].map(until);
        let meant = [Until::First, Until::Complete, Until::Converged, Until::Seconds(0.0), Until::Seconds(2.5)];
        assert_eq!(words, meant.map(Ok));
        for bad in ["", "soon", "-1", "nan", "inf", "1s"] {
            assert!(until(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn lights_are_parsed() {
        assert_eq!(light("head").unwrap().kind, LightKind::Headlight);
        let sun = light("sun:0,0,-1*0.5").unwrap();
        assert_eq!((sun.kind, sun.intensity), (LightKind::Directional(-DVec3::Z), 0.5));
        for bad in ["", "moon", "sun:0,0,0", "point:1,2", "head*-1", "head*x"] {
            assert!(light(bad).is_err(), "{bad}");
        }
    }
}
