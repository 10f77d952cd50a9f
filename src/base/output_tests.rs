use super::*;

fn names(folder: &Path) -> Vec<String> {
    let mut names: Vec<_> =
        fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

#[test]
fn it_appears_only_when_published() {
    let dir = tempfile::tempdir().unwrap();
    let target = dir.path().join("a");
    fs::write(&target, "old").unwrap();
    let mut t = OutputFile::create(&target).unwrap();
    t.append(b"new").unwrap();
    t.overwrite_start(b"N").unwrap();
    assert_eq!(fs::read(&target).unwrap(), b"old");
    assert_eq!(names(dir.path()).len(), 2);
    t.publish().unwrap();
    drop(t);
    assert_eq!(fs::read(&target).unwrap(), b"New");
    assert_eq!(names(dir.path()), ["a"]);
}

#[test]
fn dropped_it_leaves_nothing() {
    let dir = tempfile::tempdir().unwrap();
    let mut t = OutputFile::create(&dir.path().join("a")).unwrap();
    t.append(b"new").unwrap();
    drop(t);
    assert!(names(dir.path()).is_empty());
}

#[test]
fn stale_ones_go_and_living_ones_stay() {
    let dir = tempfile::tempdir().unwrap();
    let target = dir.path().join("a");
    let living = OutputFile::create(&target).unwrap();
    let stale = dir.path().join(format!("{}1-0{SUFFIX}", prefix(&target).unwrap()));
    let other = dir.path().join(format!("{}1-0{SUFFIX}", prefix(Path::new("b")).unwrap()));
    fs::write(&stale, "x").unwrap();
    fs::write(&other, "x").unwrap();
    let second = OutputFile::create(&target).unwrap();
    assert!(!stale.exists() && other.exists());
    assert!(living.path.as_ref().unwrap().exists() && second.path.as_ref().unwrap().exists());
}

#[test]
fn targets_that_must_not_be_replaced_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    for target in [dir.path().to_path_buf(), dir.path().join("none/a"), "/dev/null".into(), "".into(), "/".into()] {
        assert!(OutputFile::create(&target).is_err(), "{target:?}");
    }
    assert!(names(dir.path()).is_empty());
}

#[cfg(unix)]
#[test]
fn a_link_stays_a_link() {
    let dir = tempfile::tempdir().unwrap();
    let (file, link) = (dir.path().join("file"), dir.path().join("link"));
    fs::write(&file, "old").unwrap();
    std::os::unix::fs::symlink("file", &link).unwrap();
    let mut t = OutputFile::create(&link).unwrap();
    t.append(b"new").unwrap();
    t.publish().unwrap();
    assert!(fs::symlink_metadata(&link).unwrap().is_symlink());
    assert_eq!(fs::read(&file).unwrap(), b"new");
}

#[test]
fn a_name_as_long_as_names_can_be() {
    let dir = tempfile::tempdir().unwrap();
    let target = dir.path().join("x".repeat(255));
    OutputFile::create(&target).unwrap().publish().unwrap();
    assert!(target.exists());
}

/// The kinds of files that a careless rename would destroy: they stay, and the error says what they are.
#[cfg(unix)]
#[test]
fn links_to_no_file_pipes_sockets_and_read_only_files_are_refused() {
    use std::os::unix::fs::{FileTypeExt, PermissionsExt, symlink};
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name);
    let fifo = process::Command::new("mkfifo").arg(at("fifo")).status().unwrap();
    assert!(fifo.success());
    let _socket = std::os::unix::net::UnixListener::bind(at("socket")).unwrap();
    fs::write(at("read_only"), "old").unwrap();
    fs::set_permissions(at("read_only"), fs::Permissions::from_mode(0o444)).unwrap();
    for (name, to) in [("to_fifo", "fifo"), ("to_nothing", "none"), ("to_itself", "to_itself"), ("to_folder", ".")] {
        symlink(to, at(name)).unwrap();
    }
    let before = names(dir.path());
    for (name, why) in [
        ("fifo", "not a regular file"),
        ("socket", "not a regular file"),
        ("read_only", "read-only"),
        ("to_fifo", "not a regular file"),
        ("to_nothing", "leads to no file"),
        ("to_itself", "too many"),
        ("to_folder", "is a folder"),
    ] {
        for result in [OutputFile::create(&at(name)).map(drop), check(&at(name), &[] as &[&Path])] {
            let error = result.unwrap_err().to_string();
            assert!(error.contains(name) && error.contains(why), "{error}");
        }
    }
    assert!(check(Path::new("/dev/stdout"), &[] as &[&Path]).is_err());
    assert_eq!(names(dir.path()), before);
    assert!(fs::symlink_metadata(at("fifo")).unwrap().file_type().is_fifo());
}

#[cfg(unix)]
#[test]
fn an_input_is_no_output_by_whatever_name() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name);
    fs::write(at("input"), "data").unwrap();
    fs::write(at("other"), "data").unwrap();
    fs::hard_link(at("input"), at("hard")).unwrap();
    std::os::unix::fs::symlink("input", at("soft")).unwrap();
    fs::create_dir(at("folder")).unwrap();
    let inputs = [at("missing"), at("other"), at("input")];
    for name in ["input", "hard", "soft", "folder/../input", "other"] {
        let error = check(&at(name), &inputs).unwrap_err();
        assert!(matches!(&error, Error::BadArgument(why) if why.contains(name) && why.contains("input")), "{error}");
    }
    for name in ["missing", "new"] {
        check(&at(name), &inputs).unwrap();
    }
    check(&at("other"), &inputs[2..]).unwrap();
}

#[test]
fn a_stream_gets_its_start_and_the_rest() {
    let mut out = Vec::new();
    let mut stream = OutputStream::new(&mut out).unwrap();
    stream.append(b"0000 and ").unwrap();
    stream.append(b"the rest").unwrap();
    stream.overwrite_start(b"1234").unwrap();
    stream.publish().unwrap();
    drop(stream);
    assert_eq!(out, b"1234 and the rest");
}

#[cfg(unix)]
#[test]
fn a_file_that_is_replaced_keeps_its_permissions_group_and_owner() {
    use std::os::unix::fs::{MetadataExt, PermissionsExt, chown};
    let dir = tempfile::tempdir().unwrap();
    let (target, fresh, link) = (dir.path().join("a"), dir.path().join("fresh"), dir.path().join("link"));
    fs::write(&fresh, "").unwrap();
    let fresh = fs::metadata(fresh).unwrap();
    std::os::unix::fs::symlink("a", &link).unwrap();
    let publish = |at: &Path| {
        let mut t = OutputFile::create(at).unwrap();
        t.append(b"new").unwrap();
        let before = t.file.metadata().unwrap().mode();
        t.publish().unwrap();
        (before & 0o777, fs::metadata(&target).unwrap())
    };
    let (_, made) = publish(&target);
    assert_eq!((made.mode(), made.uid(), made.gid()), (fresh.mode(), fresh.uid(), fresh.gid()));
    for mode in [0o600, 0o640, 0o604, 0o660, 0o777, 0o200, 0o4755] {
        for at in [&target, &link] {
            fs::set_permissions(&target, fs::Permissions::from_mode(mode)).unwrap();
            let (while_written, made) = publish(at);
            assert_eq!((while_written, made.mode() & 0o7777), (0o600, mode & 0o777), "{mode:o}");
        }
    }
    // Only a privileged process can give files away.
    fs::set_permissions(&target, fs::Permissions::from_mode(0o640)).unwrap();
    if chown(&target, Some(12345), Some(54321)).is_ok() {
        let (_, made) = publish(&target);
        assert_eq!((made.mode() & 0o777, made.uid(), made.gid()), (0o640, 12345, 54321));
    }
}

#[cfg(unix)]
#[test]
fn permissions_never_grow_where_the_group_is_lost() {
    for (mode, expected) in [(0o640, 0o600), (0o644, 0o644), (0o604, 0o600), (0o666, 0o666), (0o751, 0o711)] {
        assert_eq!((permissions(mode, true), permissions(mode, false)), (mode, expected), "{mode:o}");
    }
}

#[test]
fn an_output_is_none_of_the_files_that_were_read() {
    let dir = tempfile::tempdir().unwrap();
    let (target, inputs, quota) = (dir.path().join("a"), Inputs::default(), Quota::new(5));
    fs::write(&target, "old").unwrap();
    let mut t = OutputFile::create(&target).unwrap().guarded(&inputs, &quota).unwrap();
    t.append(b"new").unwrap();
    assert!(matches!(t.append(b"news"), Err(Error::OverLimit { most: 5, limit: "max_bytes", .. })));
    // It is read only now.
    inputs.add(&target, Identity::of(&target).unwrap());
    assert!(matches!(t.publish(), Err(Error::BadArgument(why)) if why.contains("same file as the input")));
    drop(t);
    assert!(OutputFile::create(&target).unwrap().guarded(&inputs, &quota).is_err());
    assert_eq!((fs::read(&target).unwrap(), names(dir.path())), (b"old".to_vec(), vec!["a".to_owned()]));
    quota.take(5).unwrap();
}
