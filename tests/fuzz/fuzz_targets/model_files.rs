#![no_main]

libfuzzer_sys::fuzz_target!(
    init: outcrop_fuzz::seeds_on_request("model_files"),
    |data: &[u8]| outcrop_fuzz::run("model_files", data)
);
