//! The key that authenticates commands to the links.

use crate::stack::Stack;
use fss_wire::link::Key;
use miette::{IntoDiagnostic, Result, WrapErr, miette};
use std::fs::File;
use std::io::{Read, Write};
use std::path::Path;

/// Makes a key for the links of this run, where the launch file names one in the run's folder and none is there.
///
/// # Errors
/// Where the folder refuses.
pub fn make_link_key(stack: &Stack, folder: &Path) -> Result<()> {
    use std::os::unix::fs::OpenOptionsExt;
    let Some(name) = stack.launch.devices.link_key.as_ref().filter(|name| name.is_relative()) else { return Ok(()) };
    let path = folder.join(name);
    if path.exists() {
        return Ok(());
    }
    let say = || format!("cannot make the link key {}", path.display());
    let mut secret = [0; 32];
    File::open("/dev/urandom")
        .and_then(|mut random| random.read_exact(&mut secret))
        .into_diagnostic()
        .wrap_err_with(say)?;
    let file = File::options().write(true).create_new(true).mode(0o600).open(&path);
    file.and_then(|mut file| file.write_all(&secret)).into_diagnostic().wrap_err_with(say)
}

/// The secret of the key that authenticates commands to the links; only its owner may read it.
pub(crate) fn read_secret(path: &Path) -> Result<Vec<u8>> {
    use std::os::unix::fs::PermissionsExt;
    let say = || format!("link key {} ([devices] link_key)", path.display());
    let mode = std::fs::metadata(path).into_diagnostic().wrap_err_with(say)?.permissions().mode();
    if mode & 0o077 != 0 {
        return Err(miette!(
            help = format!("chmod 600 {}", path.display()),
            "others may read it (mode {:o})",
            mode & 0o777
        )
        .wrap_err(say()));
    }
    let secret = std::fs::read(path).into_diagnostic().wrap_err_with(say)?;
    Key::new(&secret).into_diagnostic().wrap_err_with(say)?;
    Ok(secret)
}

/// The secret on a virtual clock, where both ends are in one process.
pub(crate) fn secret_of(seed: u64) -> [u8; 32] {
    let mut secret = [0; 32];
    secret[..8].copy_from_slice(&seed.to_le_bytes());
    secret
}
