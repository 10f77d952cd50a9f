//! The C ABI: header, layouts of structs, programs in C and C++, and the snippets of the guide.

mod abi;
mod abi_header;
mod abi_layout;
#[cfg(unix)]
mod guide;
