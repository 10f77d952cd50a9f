//! Sources that lie: they fail, give other bytes, give bytes that change from read to read, or state a wrong length.
//! Each answer is that of the intact model, or an error about the source; once the source is true again, all are right.

use super::base_models::{self, NAME};
use super::builds::contexts;
use super::rng::Rng;
use super::within;
use arbitrary::{Arbitrary, Result, Unstructured};
use glam::{DAffine3, DVec3};
use outcrop::base::progress::Cancel;
use outcrop::math::Ray;
use outcrop::query::{Hit, QueryOptions};
use outcrop::scene::{Context, Model, Scene, SceneState};
use outcrop::store::Source;
use outcrop::{Error, Frame, FrameOptions, FrameSettings, FrameState, Outputs};
use std::io;
use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering::SeqCst};
use std::sync::{Arc, OnceLock};
use std::time::Duration;

const BUDGET: u64 = 24 << 20;
const LONG: Duration = Duration::from_secs(30);

/// What a source does in one read.
#[derive(Debug, Clone, Copy)]
enum Lie {
    None,
    Fails(io::ErrorKind),
    /// Another model's bytes, or zeros.
    Other(usize),
    /// A byte at this place in the buffer is changed.
    Flips(u16, u8),
    /// The rest of the buffer is left as it was.
    Short(u16),
    /// The bytes of another place in the file.
    Moved(i16),
}

const KINDS: [io::ErrorKind; 5] = [
    io::ErrorKind::UnexpectedEof,
    io::ErrorKind::Interrupted,
    io::ErrorKind::WouldBlock,
    io::ErrorKind::TimedOut,
    io::ErrorKind::Other,
];

impl<'a> Arbitrary<'a> for Lie {
    fn arbitrary(u: &mut Unstructured<'a>) -> Result<Self> {
        Ok(match u.int_in_range(0..=9)? {
            0..=4 => Lie::None,
            5 => Lie::Fails(*u.choose(&KINDS)?),
            6 => Lie::Other(u.int_in_range(0..=base_models::COUNT)?),
            7 => Lie::Flips(u.arbitrary()?, u.arbitrary()?),
            8 => Lie::Short(u.arbitrary()?),
            _ => Lie::Moved(u.arbitrary()?),
        })
    }
}

struct Liar {
    bytes: &'static [u8],
    len: u64,
    lies: Vec<Lie>,
    reads: AtomicUsize,
    is_true: AtomicBool,
}

impl Source for Liar {
    fn len(&self) -> u64 {
        self.len
    }

    fn read_at(&self, offset: u64, buf: &mut [u8]) -> io::Result<()> {
        let read = self.reads.fetch_add(1, SeqCst);
        let lie = if self.is_true.load(SeqCst) { Lie::None } else { self.lies[read % self.lies.len()] };
        let fill = |buf: &mut [u8], from: &[u8], offset: i128| {
            let start = usize::try_from(offset).unwrap_or(usize::MAX);
            let some = from.get(start..).unwrap_or_default();
            let len = some.len().min(buf.len());
            buf[..len].copy_from_slice(&some[..len]);
        };
        let offset = i128::from(offset);
        match lie {
            Lie::Fails(kind) => return Err(kind.into()),
            Lie::Other(model) if model < base_models::COUNT => fill(buf, base_models::bytes(model), offset),
            Lie::Other(_) => buf.fill(0),
            Lie::Moved(by) => fill(buf, self.bytes, offset + i128::from(by)),
            Lie::None | Lie::Short(_) | Lie::Flips(..) => {
                let end = if let Lie::Short(len) = lie { buf.len().min(len.into()) } else { buf.len() };
                fill(&mut buf[..end], self.bytes, offset);
                if let Lie::Flips(at, mask) = lie
                    && !buf.is_empty()
                {
                    let at = usize::from(at) % buf.len();
                    buf[at] ^= mask;
                }
            }
        }
        Ok(())
    }

    fn name(&self) -> &Path {
        Path::new(NAME)
    }
}

/// The target.
pub fn run(data: &[u8]) {
    let Ok((model, liar)) = liar(&mut Unstructured::new(data)) else { return };
    let contexts = contexts(BUDGET);
    within(contexts.len() as u64 * BUDGET + (64 << 20), || check(&contexts[0], model, Arc::new(liar)));
}

fn liar(u: &mut Unstructured) -> Result<(usize, Liar)> {
    let model = u.int_in_range(0..=base_models::COUNT - 1)?;
    let bytes = base_models::bytes(model);
    let true_len = bytes.len() as u64;
    let len = match u.int_in_range(0..=9)? {
        0 => true_len.wrapping_add_signed(u.arbitrary::<i8>()?.into()),
        1 => u.arbitrary()?,
        _ => true_len,
    };
    // All reads are true up to this one.
    let mut lies = vec![Lie::None; u.int_in_range(0..=12)?];
    lies.extend(u.arbitrary_iter()?.take(12).collect::<Result<Vec<Lie>>>()?);
    lies.push(u.arbitrary()?);
    Ok((model, Liar { bytes, len, lies, reads: AtomicUsize::new(0), is_true: AtomicBool::new(false) }))
}

fn rays() -> Vec<Ray> {
    let mut rng = Rng::new(5);
    let ray = |_| {
        let from = DVec3::X * 1.5 + rng.direction() * 6.0;
        Ray::new(from, (rng.inside(DVec3::NEG_ONE, DVec3::new(4.0, 1.0, 1.0)) - from).as_vec3())
    };
    (0..30).map(ray).collect()
}

/// The hits of the intact model.
fn intact(context: &Context, model: usize) -> &'static [Hit] {
    static HITS: [OnceLock<Vec<Hit>>; base_models::COUNT] = [const { OnceLock::new() }; base_models::COUNT];
    HITS[model].get_or_init(|| {
        let bytes = base_models::bytes(model);
        let source = Liar {
            bytes,
            len: bytes.len() as u64,
            lies: vec![Lie::None],
            reads: AtomicUsize::new(0),
            is_true: AtomicBool::new(true),
        };
        let (_, state) = open(context, Arc::new(source)).expect("the intact model");
        hits(&state).expect("its hits")
    })
}

fn open(context: &Context, source: Arc<dyn Source>) -> outcrop::Result<(Model, Arc<SceneState>)> {
    let model = Model::open_source(context, source)?;
    let scene = Scene::new(context);
    scene.add_instance(&model, 7, DAffine3::IDENTITY)?;
    scene.commit()?;
    Ok((model, scene.state()))
}

fn hits(state: &SceneState) -> outcrop::Result<Vec<Hit>> {
    let rays = rays();
    let mut hits = vec![Hit::MISS; rays.len()];
    state.closest(&rays, QueryOptions::default(), &mut hits)?;
    Ok(hits)
}

fn about_the_source(error: &Error) {
    match error {
        Error::Corrupt { file, .. } | Error::NewerFormat { file, .. } | Error::Io { path: file, .. } => {
            assert_eq!(file, Path::new(NAME), "{error}");
        }
        other => panic!("{other:?}"),
    }
}

fn check(context: &Context, model: usize, liar: Arc<Liar>) {
    let expected = intact(context, model);
    let (model, state) = match open(context, Arc::clone(&liar) as Arc<dyn Source>) {
        Ok(opened) => opened,
        Err(error) => return about_the_source(&error),
    };
    assert_eq!(liar.len, liar.bytes.len() as u64, "a file of another length opened");
    let right = |answer: outcrop::Result<Vec<Hit>>| match answer {
        Ok(found) => assert!(found == expected, "wrong hits"),
        Err(error) => about_the_source(&error),
    };
    right(hits(&state));
    let _ = model.check(&Cancel::new()).map_err(|e| about_the_source(&e));
    let options = FrameOptions { width: 12, height: 8, outputs: Outputs::ALL, ..FrameOptions::default() };
    let frame = Frame::new(context, options).expect("a small frame");
    frame.request(&state, &model.views()[0], &FrameSettings::default()).expect("a request");
    let status = frame.wait(LONG);
    assert_ne!(status.state, FrameState::Running, "it does not end: {status:?}");
    if let Some(error) = status.error {
        about_the_source(&error);
    }
    liar.is_true.store(true, SeqCst);
    assert!(hits(&state).expect("the source is true again") == expected, "wrong hits of a true source");
}
