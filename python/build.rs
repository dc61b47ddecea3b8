//! The module exports what Python asks for alone, and not the names that libraries in it have for each other.

fn main() {
    // zig's linker knows no such option.
    let is_zig = std::env::var_os("CARGO_ZIGBUILD_TARGET").is_some();
    if std::env::var("CARGO_CFG_TARGET_OS").is_ok_and(|system| system == "linux") && !is_zig {
        println!("cargo:rustc-cdylib-link-arg=-Wl,--exclude-libs=ALL");
    }
    println!("cargo:rerun-if-env-changed=CARGO_ZIGBUILD_TARGET");
    println!("cargo:rerun-if-changed=build.rs");
}
