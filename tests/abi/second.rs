//! Another Rust library in the same program, with its own copy of the standard library.

/// 1 if catching a panic works here too.
#[unsafe(no_mangle)]
pub extern "C" fn second_catches(n: u32) -> u32 {
    let caught = std::panic::catch_unwind(|| {
        let v: Vec<u32> = (0..n).collect();
        v[n as usize]
    });
    u32::from(caught.is_err())
}
