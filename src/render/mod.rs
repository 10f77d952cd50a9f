//! (render: being built.)
