//! Measures outcrop beside other ray tracers, speed and accuracy together, and draws the charts. `make bench` and `make
//! charts` are how it is used; `benchmarks.toml` says what is measured.

mod accuracy;
mod assemblies;
mod builds;
mod charts;
mod clash;
mod cold;
mod counted;
#[path = "../../common/mod.rs"]
mod common;
mod data;
mod decode;
mod everyday;
mod expected;
mod failure;
mod looks;
mod many;
mod nearest;
mod ours;
mod pairs;
mod peers;
mod pictures;
mod placed;
mod rays;
mod record;
mod scenes;
mod settings;
mod sides;
mod surfaces;
mod trace;

use clap::Parser;
use data::{Benchmark, Data, Measure};
use expected::Book;
use failure::{Failure, Outcome};
use pairs::Clock;
use scenes::Scene;
use std::collections::BTreeSet;
use std::path::Path;
use std::process::ExitCode;
use trace::Task;

/// Measure outcrop beside other ray tracers, and draw the charts
#[derive(Parser)]
enum Command {
    /// Measure, and append the results to target/bench/results.jsonl
    Run(Chosen),
    /// Write the expected answers anew, after a meant change
    Expect(Chosen),
    /// Measure what there are no results of, by this version on this machine, and draw the charts
    Charts(Drawn),
}

#[derive(clap::Args)]
struct Drawn {
    #[command(flatten)]
    chosen: Chosen,
    /// Also take results of other versions
    #[arg(long)]
    keep: bool,
}

#[derive(clap::Args)]
struct Chosen {
    /// Also what takes long or much memory
    #[arg(long)]
    full: bool,
    /// Only benchmarks of these names
    #[arg(long, value_name = "NAME", value_delimiter = ',')]
    only: Vec<String>,
    /// Only these scenes
    #[arg(long, value_name = "NAME", value_delimiter = ',')]
    scene: Vec<String>,
    /// Time rays of one thread, by the CPU time of that thread: on a busy machine
    #[arg(long)]
    cpu_time: bool,
}

impl Chosen {
    fn clock(&self) -> Clock {
        if self.cpu_time { Clock::Thread } else { Clock::Wall }
    }

    fn has(&self, benchmark: &Benchmark, scene: &str) -> bool {
        let among = |names: &[String], name: &str| names.is_empty() || names.iter().any(|n| n == name);
        let is_asked_for = self.only.contains(&benchmark.name);
        (self.full || !benchmark.full || is_asked_for)
            && among(&self.only, &benchmark.name)
            && among(&self.scene, scene)
    }
}

fn main() -> ExitCode {
    let done = match Command::parse() {
        Command::Run(chosen) => run(false, chosen.clock(), |benchmark, scene| chosen.has(benchmark, scene)),
        Command::Expect(chosen) => run(true, Clock::Wall, |benchmark, scene| chosen.has(benchmark, scene)),
        Command::Charts(Drawn { chosen, keep }) => draw(&chosen, keep),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(why) => {
            eprintln!("bench: {why}");
            ExitCode::FAILURE
        }
    }
}

/// Charts, of results that are there now or already; says of which.
fn draw(chosen: &Chosen, keep: bool) -> Outcome {
    let data = data()?;
    let (mut known, now) = (record::read(&record::path())?, trace::run_now());
    // Of a changed tree nobody knows what was measured.
    known.retain(|r| {
        keep || r.run.machine == now.machine
            && r.run.isa == now.isa
            && r.run.commit == now.commit
            && !r.run.is_changed()
    });
    let of =
        |benchmark: &Benchmark, scene: &str| known.iter().rfind(|r| r.benchmark == benchmark.name && r.scene == scene);
    let is_lacking =
        |benchmark: &Benchmark, scene: &str| chosen.has(benchmark, scene) && of(benchmark, scene).is_none();
    let all =
        || data.benchmarks.iter().flat_map(|benchmark| benchmark.scenes.iter().map(move |scene| (benchmark, scene)));
    for (benchmark, scene) in all() {
        if let Some(last) = of(benchmark, scene) {
            let (name, run) = (&benchmark.name, &last.run);
            eprintln!("{name}/{scene}: there are results of version {}, {}: not measured anew", run.commit, run.date);
        }
    }
    let mut is_measured: BTreeSet<(String, String)> =
        known.iter().map(|r| (r.benchmark.clone(), r.scene.clone())).collect();
    let lacking: Vec<_> = all().filter(|(benchmark, scene)| is_lacking(benchmark, scene)).collect();
    is_measured.extend(lacking.iter().map(|(benchmark, scene)| (benchmark.name.clone(), (*scene).clone())));
    if !lacking.is_empty() {
        run(false, chosen.clock(), is_lacking)?;
    }
    let mut records = record::read(&record::path())?;
    records.retain(|r| is_measured.contains(&(r.benchmark.clone(), r.scene.clone())));
    charts::draw(&records, &charts::folder())
}

fn data() -> Result<Data, Failure> {
    Ok(Data::read(&Path::new(env!("CARGO_MANIFEST_DIR")).join("benchmarks.toml"))?)
}

/// Measures what is picked, scene by scene; or only writes down what its answers are.
fn run(is_only_expecting: bool, clock: Clock, picks: impl Fn(&Benchmark, &str) -> bool) -> Outcome {
    let data = data()?;
    let mut book = Book::open(is_only_expecting)?;
    let (mut found, mut all) = (0, Vec::new());
    for benchmark in &data.benchmarks {
        for name in benchmark.scenes.iter().filter(|scene| picks(benchmark, scene)) {
            found += 1;
            let is_of_several = matches!(benchmark.measure, Measure::Cold | Measure::Build | Measure::Decode);
            if clock == Clock::Thread && is_of_several {
                eprintln!("skipped: {}/{name} works in several threads", benchmark.name);
                continue;
            }
            let Some(scene) = Scene::find(data.scene(name))? else { continue };
            let mut task = Task { data: &data, benchmark, scene: &scene, book: &mut book, is_only_expecting, clock };
            let records = match benchmark.measure {
                Measure::Trace => trace::measure(&mut task)?,
                Measure::Cold => cold::measure(&mut task)?,
                Measure::Build => builds::measure(&mut task)?,
                Measure::Decode => decode::measure(&mut task)?,
                Measure::Settings => settings::measure(&mut task)?,
                Measure::Clash => clash::measure(&mut task)?,
                Measure::Nearest => nearest::measure(&mut task)?,
                Measure::Distance => nearest::apart::measure(&mut task)?,
                Measure::Many => many::measure(&mut task)?,
                Measure::Surfaces => surfaces::measure(&mut task)?,
            };
            record::append(&record::path(), &records)?;
            all.extend(records);
        }
    }
    let tables =
        [settings::table(&all), clash::table(&all), nearest::table(&all), many::table(&all), surfaces::table(&all)];
    print!("{}", tables.concat());
    if found == 0 {
        return Err(Failure::new("no such benchmark or scene"));
    }
    book.close()
}
