//! Builds that end early, in processes of their own.

use super::*;
use std::path::PathBuf;
use std::process::{Command, Stdio};

const PATH: &str = "OUTCROP_TEST_ENDING_EARLY";

/// Not a test by itself: writes blocks until something stops it. Says when it has begun.
#[test]
fn child() {
    let Some(path) = std::env::var_os(PATH).map(PathBuf::from) else { return };
    let mut writer = Writer::create(&path).unwrap();
    let payload: Vec<u8> = (0..60_000u32).map(|i| (i.wrapping_mul(2654435761) >> 13) as u8).collect();
    println!("began");
    let e = loop {
        std::thread::sleep(std::time::Duration::from_millis(1));
        if let Err(e) = writer.block(&payload, 60_000) {
            break e;
        }
    };
    drop(writer);
    println!("ended: {e}");
    std::process::exit(3);
}

fn command(shell: &str, path: &Path) -> Command {
    let mut command = Command::new("sh");
    let me = std::env::current_exe().unwrap();
    command.args(["-c", &format!("{shell} exec \"$0\" --exact ending_early::child --nocapture")]).arg(me);
    command.env(PATH, path).stdout(Stdio::piped());
    command
}

fn names(folder: &Path) -> Vec<String> {
    std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect()
}

#[test]
fn out_of_space_the_old_file_stays_and_the_temporary_goes() {
    let dir = fast_dir();
    let path = dir.path().join("model.oc");
    std::fs::write(&path, "old").unwrap();
    // A limit on the size of files stands for a full disk; the signal is turned into an error.
    let out = command("trap '' XFSZ; ulimit -f 4000;", &path).output().unwrap();
    let said = String::from_utf8_lossy(&out.stdout).into_owned();
    assert_eq!(out.status.code(), Some(3), "{said}");
    assert!(said.contains("ended: ") && said.contains("model.oc: write failed"), "{said}");
    assert_eq!(std::fs::read(&path).unwrap(), b"old");
    assert_eq!(names(dir.path()), ["model.oc"]);
}

#[test]
fn killed_the_old_file_stays_and_the_next_build_tidies_up() {
    use std::io::{BufRead, BufReader};
    let dir = fast_dir();
    let path = dir.path().join("model.oc");
    std::fs::write(&path, "old").unwrap();
    let mut child = command("", &path).spawn().unwrap();
    let mut lines = BufReader::new(child.stdout.take().unwrap()).lines();
    assert!(lines.by_ref().any(|line| line.unwrap().contains("began")));
    // A build beside a living one leaves it alone.
    drop(Writer::create(&path).unwrap());
    assert_eq!(names(dir.path()).len(), 2);
    child.kill().unwrap();
    child.wait().unwrap();
    assert_eq!(std::fs::read(&path).unwrap(), b"old");
    assert_eq!(names(dir.path()).len(), 2);
    let writer = Writer::create(&path).unwrap();
    writer.finish(&Header::default(), &[], &[], &[], &[]).unwrap();
    assert_eq!(names(dir.path()), ["model.oc"]);
    ModelFile::open_path(&path).unwrap();
}
