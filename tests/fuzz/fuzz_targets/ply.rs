#![no_main]

libfuzzer_sys::fuzz_target!(
    init: outcrop_fuzz::seeds_on_request("ply"),
    |data: &[u8]| outcrop_fuzz::run("ply", data)
);
