//! The command line `outcrop`, with one command per file, over the public API of the crate.
//!
//! Results go to stdout (exactly one JSON object with `--json`), everything else to stderr. Exit codes: 0 success, 1
//! failure, 2 wrong usage, 130 interrupted by Ctrl-C.
#![forbid(unsafe_code)]

mod accuracy;
mod bench;
mod build;
mod check;
mod clash;
mod clash_groups;
mod common;
mod crossings;
mod export;
mod forest;
mod generate;
mod info;
mod info_scene;
mod nearest;
mod occurrence;
mod output;
mod rays;
mod render;
mod view;

use clap::{Parser, Subcommand};
use common::Outcome;
use std::process::ExitCode;

/// Ray traces models larger than memory: builds, checks, renders and measures .oc files
#[derive(Parser)]
#[command(version, max_term_width = 100)]
struct Cli {
    #[command(subcommand)]
    verb: Verb,
}

#[derive(Subcommand)]
enum Verb {
    Generate(generate::Args),
    Build(build::Args),
    Info(info::Args),
    Check(check::Args),
    Crossings(crossings::Args),
    Clash(clash::Args),
    Nearest(nearest::Args),
    Render(render::Args),
    Bench(bench::Args),
    Export(export::Args),
}

fn run(verb: Verb) -> Outcome {
    match verb {
        Verb::Generate(args) => generate::run(&args),
        Verb::Build(args) => build::run(&args),
        Verb::Info(args) => info::run(&args),
        Verb::Check(args) => check::run(&args),
        Verb::Crossings(args) => crossings::run(&args),
        Verb::Clash(args) => clash::run(&args),
        Verb::Nearest(args) => nearest::run(&args),
        Verb::Render(args) => render::run(&args),
        Verb::Bench(args) => bench::run(&args),
        Verb::Export(args) => export::run(&args),
    }
}

fn main() -> ExitCode {
    match run(Cli::parse().verb) {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            eprintln!("outcrop: {failure}");
            ExitCode::from(failure.exit_code())
        }
    }
}
