//! Makes the keys of a host and an agent.
//!
//! Pairing makes an authority, signs one certificate for the agent and one for the host, and
//! discards the authority's key: nobody can be added later, a new pair is made instead.

use evrig_pi::keys::{AGENT_NAME, AUTHORITY_FILE, CERTIFICATE_FILE, KEY_FILE};
use rcgen::{
    BasicConstraints, CertificateParams, DnType, ExtendedKeyUsagePurpose, IsCa, Issuer, KeyPair,
    KeyUsagePurpose,
};
use std::fs;
use std::io::{self, Write};
use std::os::unix::fs::{DirBuilderExt, OpenOptionsExt};
use std::path::{Path, PathBuf};

/// Why no keys were made.
#[derive(Debug, thiserror::Error)]
pub enum PairingError {
    /// A file cannot be written.
    #[error("{}: {source}; choose another directory with --out", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        source: io::Error,
    },
    /// Keys exist already.
    #[error("{} is there already; remove it, or pair into another directory", path.display())]
    Exists {
        /// The directory.
        path: PathBuf,
    },
    /// Making keys failed.
    #[error("keys cannot be made: {0}")]
    Making(#[from] rcgen::Error),
}

/// The two directories of keys that pairing made.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct KeyPairPaths {
    /// Stays on the host.
    pub host: PathBuf,
    /// Goes to the Pi.
    pub agent: PathBuf,
}

/// Makes a pair of key directories, `host` and `agent`, below `directory`; files are for the owner
/// only.
///
/// # Errors
/// When one is there already or cannot be written.
pub fn pair(directory: &Path) -> Result<KeyPairPaths, PairingError> {
    let pair = KeyPairPaths { host: directory.join("host"), agent: directory.join("agent") };
    for path in [&pair.host, &pair.agent] {
        if path.exists() {
            return Err(PairingError::Exists { path: path.clone() });
        }
    }
    let mut params = CertificateParams::new(Vec::new())?;
    params.is_ca = IsCa::Ca(BasicConstraints::Constrained(0));
    params.key_usages = vec![KeyUsagePurpose::KeyCertSign];
    params.distinguished_name.push(DnType::CommonName, "evrig pair");
    let key = KeyPair::generate()?;
    let authority = params.self_signed(&key)?;
    let issuer = Issuer::new(params, key);
    let sides = [
        (&pair.agent, AGENT_NAME, ExtendedKeyUsagePurpose::ServerAuth),
        (&pair.host, "host.evrig", ExtendedKeyUsagePurpose::ClientAuth),
    ];
    for (path, name, usage) in sides {
        let mut params = CertificateParams::new(vec![name.to_owned()])?;
        params.distinguished_name.push(DnType::CommonName, name);
        params.key_usages = vec![KeyUsagePurpose::DigitalSignature];
        params.extended_key_usages = vec![usage];
        params.use_authority_key_identifier_extension = true;
        let key = KeyPair::generate()?;
        let certificate = params.signed_by(&key, &issuer)?;
        let made = fs::DirBuilder::new().recursive(true).mode(0o700).create(path);
        made.map_err(|source| PairingError::Io { path: path.clone(), source })?;
        write_private(&path.join(AUTHORITY_FILE), &authority.pem())?;
        write_private(&path.join(CERTIFICATE_FILE), &certificate.pem())?;
        write_private(&path.join(KEY_FILE), &key.serialize_pem())?;
    }
    Ok(pair)
}

fn write_private(path: &Path, text: &str) -> Result<(), PairingError> {
    let file = fs::OpenOptions::new().write(true).create_new(true).mode(0o600).open(path);
    file.and_then(|mut file| {
        file.write_all(text.as_bytes())?;
        file.sync_all()
    })
    .map_err(|source| PairingError::Io { path: path.to_owned(), source })
}

#[cfg(test)]
mod tests {
    use super::*;
    use evrig_pi::keys::{Keys, KeysError};
    use std::os::unix::fs::PermissionsExt;

    #[test]
    fn a_pair_is_for_its_owner_only_and_works_on_either_end() {
        let folder = tempfile::tempdir().unwrap();
        let made = pair(&folder.path().join("keys")).unwrap();
        for side in [&made.host, &made.agent] {
            assert_eq!(fs::metadata(side).unwrap().permissions().mode() & 0o777, 0o700);
            for file in [AUTHORITY_FILE, CERTIFICATE_FILE, KEY_FILE] {
                let mode = fs::metadata(side.join(file)).unwrap().permissions().mode();
                assert_eq!(mode & 0o777, 0o600, "{file}");
            }
        }
        Keys::read(&made.agent).unwrap().server().unwrap();
        Keys::read(&made.host).unwrap().client().unwrap();
        assert!(matches!(pair(&folder.path().join("keys")), Err(PairingError::Exists { .. })));
    }

    #[test]
    fn keys_that_others_can_read_or_that_do_not_belong_together_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let made = pair(folder.path()).unwrap();
        let key = made.host.join(KEY_FILE);
        fs::set_permissions(&key, fs::Permissions::from_mode(0o644)).unwrap();
        let message = Keys::read(&made.host).unwrap_err().to_string();
        assert!(message.contains("644") && message.contains("chmod"), "{message}");
        fs::set_permissions(&key, fs::Permissions::from_mode(0o600)).unwrap();
        fs::copy(made.agent.join(KEY_FILE), &key).unwrap();
        assert!(matches!(Keys::read(&made.host).unwrap().client(), Err(KeysError::Invalid { .. })));
        fs::write(&key, "no key").unwrap();
        assert!(matches!(Keys::read(&made.host), Err(KeysError::Invalid { .. })));
        let message = Keys::read(&folder.path().join("absent")).unwrap_err().to_string();
        assert!(message.contains("evrig pair"), "{message}");
    }
}
