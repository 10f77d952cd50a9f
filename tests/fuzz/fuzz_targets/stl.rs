#![no_main]

libfuzzer_sys::fuzz_target!(
    init: outcrop_fuzz::seeds_on_request("stl"),
    |data: &[u8]| outcrop_fuzz::run("stl", data)
);
