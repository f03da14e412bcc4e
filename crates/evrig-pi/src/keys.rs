//! The keys by which host and agent know each other: mutual TLS 1.3 under an authority of one's own.
//!
//! Pairing makes an authority, signs one certificate for the agent and one for the host, and throws
//! the authority's key away: nobody can be added later, a new pair is made instead. Each side gets a
//! directory with three PEM files: `authority.pem`, `certificate.pem` and `key.pem`.

use rcgen::{
    BasicConstraints, CertificateParams, DnType, ExtendedKeyUsagePurpose, IsCa, Issuer, KeyPair,
    KeyUsagePurpose,
};
use rustls::crypto::CryptoProvider;
use rustls::pki_types::pem::PemObject;
use rustls::pki_types::{CertificateDer, PrivateKeyDer, ServerName};
use rustls::server::WebPkiClientVerifier;
use rustls::{ClientConfig, RootCertStore, ServerConfig};
use std::fs;
use std::io::{self, Write};
use std::os::unix::fs::{DirBuilderExt, OpenOptionsExt, PermissionsExt};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// The name in every agent's certificate: who an agent is follows from its key, not from where it is.
const AGENT_NAME: &str = "agent.evrig";
const HOST_NAME: &str = "host.evrig";
const AUTHORITY: &str = "authority.pem";
const CERTIFICATE: &str = "certificate.pem";
const KEY: &str = "key.pem";

/// Why there are no usable keys.
#[derive(Debug, thiserror::Error)]
pub enum KeysError {
    /// A file cannot be read or made.
    #[error("{}: {source}; `evrig pair` makes keys", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        source: io::Error,
    },
    /// Keys are there already.
    #[error("{} is there already; remove it, or pair into another directory", path.display())]
    Exists {
        /// What is there.
        path: PathBuf,
    },
    /// A private key that others can read.
    #[error("{} can be read by others (mode {mode:03o}, expected 600); run `chmod 600` on it, or better pair anew", path.display())]
    Open {
        /// The file.
        path: PathBuf,
        /// Its permissions.
        mode: u32,
    },
    /// A file is not what its name says.
    #[error("{}: {because}; pair anew with `evrig pair`", path.display())]
    Invalid {
        /// The file.
        path: PathBuf,
        /// Expected and found.
        because: String,
    },
    /// Making keys failed.
    #[error("keys cannot be made: {0}")]
    Making(#[from] rcgen::Error),
}

/// What pairing made.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Pair {
    /// Stays on the host.
    pub host: PathBuf,
    /// Goes to the Pi.
    pub agent: PathBuf,
}

/// Makes a pair of key directories, `host` and `agent`, below `directory`; files are for the owner only.
///
/// # Errors
/// When one is there already or cannot be written.
pub fn pair(directory: &Path) -> Result<Pair, KeysError> {
    let pair = Pair { host: directory.join("host"), agent: directory.join("agent") };
    for path in [&pair.host, &pair.agent] {
        if path.exists() {
            return Err(KeysError::Exists { path: path.clone() });
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
        (&pair.host, HOST_NAME, ExtendedKeyUsagePurpose::ClientAuth),
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
        made.map_err(|source| KeysError::Io { path: path.clone(), source })?;
        write_private(&path.join(AUTHORITY), &authority.pem())?;
        write_private(&path.join(CERTIFICATE), &certificate.pem())?;
        write_private(&path.join(KEY), &key.serialize_pem())?;
    }
    Ok(pair)
}

fn write_private(path: &Path, text: &str) -> Result<(), KeysError> {
    let file = fs::OpenOptions::new().write(true).create_new(true).mode(0o600).open(path);
    file.and_then(|mut file| {
        file.write_all(text.as_bytes())?;
        file.sync_all()
    })
    .map_err(|source| KeysError::Io { path: path.to_owned(), source })
}

/// One side's keys, read and checked.
#[derive(Debug)]
pub struct Keys {
    directory: PathBuf,
    authority: RootCertStore,
    certificates: Vec<CertificateDer<'static>>,
    key: PrivateKeyDer<'static>,
    provider: Arc<CryptoProvider>,
}

impl Keys {
    /// Reads a directory that [`pair`] made.
    ///
    /// # Errors
    /// When a file is missing or wrong, or the private key can be read by others.
    pub fn read(directory: &Path) -> Result<Self, KeysError> {
        let key_path = directory.join(KEY);
        let metadata = fs::metadata(&key_path)
            .map_err(|source| KeysError::Io { path: key_path.clone(), source })?;
        let mode = metadata.permissions().mode() & 0o777;
        if mode & 0o077 != 0 {
            return Err(KeysError::Open { path: key_path, mode });
        }
        let key = PrivateKeyDer::from_pem_slice(&read(&key_path)?)
            .map_err(|error| wrong(&key_path, &error))?;
        let path = directory.join(AUTHORITY);
        let mut authority = RootCertStore::empty();
        for certificate in CertificateDer::pem_slice_iter(&read(&path)?) {
            let certificate = certificate.map_err(|error| wrong(&path, &error))?;
            authority.add(certificate).map_err(|error| wrong(&path, &error))?;
        }
        let path = directory.join(CERTIFICATE);
        let certificates: Result<Vec<_>, _> =
            CertificateDer::pem_slice_iter(&read(&path)?).collect();
        Ok(Self {
            directory: directory.to_owned(),
            authority,
            certificates: certificates.map_err(|error| wrong(&path, &error))?,
            key,
            provider: Arc::new(rustls::crypto::ring::default_provider()),
        })
    }

    /// The agent's end: only a host with the pair's other half gets in.
    ///
    /// # Errors
    /// When certificate and key do not belong together.
    pub fn server(self) -> Result<Arc<ServerConfig>, KeysError> {
        let verifier = WebPkiClientVerifier::builder_with_provider(
            Arc::new(self.authority),
            Arc::clone(&self.provider),
        );
        let verifier = verifier.build().map_err(|error| wrong(&self.directory, &error))?;
        ServerConfig::builder_with_provider(self.provider)
            .with_protocol_versions(&[&rustls::version::TLS13])
            .map_err(|error| wrong(&self.directory, &error))?
            .with_client_cert_verifier(verifier)
            .with_single_cert(self.certificates, self.key)
            .map(Arc::new)
            .map_err(|error| wrong(&self.directory, &error))
    }

    /// The host's end.
    ///
    /// # Errors
    /// When certificate and key do not belong together.
    pub fn client(self) -> Result<(Arc<ClientConfig>, ServerName<'static>), KeysError> {
        let name =
            ServerName::try_from(AGENT_NAME).map_err(|error| wrong(&self.directory, &error))?;
        let config = ClientConfig::builder_with_provider(self.provider)
            .with_protocol_versions(&[&rustls::version::TLS13])
            .map_err(|error| wrong(&self.directory, &error))?
            .with_root_certificates(self.authority)
            .with_client_auth_cert(self.certificates, self.key)
            .map_err(|error| wrong(&self.directory, &error))?;
        Ok((Arc::new(config), name))
    }
}

fn read(path: &Path) -> Result<Vec<u8>, KeysError> {
    /// A file of keys has a kilobyte or two.
    const MOST: u64 = 1 << 16;
    let io = |source| KeysError::Io { path: path.to_owned(), source };
    let found = fs::metadata(path).map_err(io)?.len();
    if found > MOST {
        let because = format!("expected PEM text of at most {MOST} bytes, found {found}");
        return Err(KeysError::Invalid { path: path.to_owned(), because });
    }
    fs::read(path).map_err(io)
}

fn wrong(path: &Path, error: &dyn std::fmt::Display) -> KeysError {
    KeysError::Invalid { path: path.to_owned(), because: error.to_string() }
}

/// Where a host looks for its keys unless the rig says otherwise: `$XDG_CONFIG_HOME/evrig/keys/host`,
/// or `~/.config/evrig/keys/host`; the agent, `.../keys/agent`.
#[must_use]
pub fn default_directory() -> PathBuf {
    let home = || std::env::var_os("HOME").map(|home| PathBuf::from(home).join(".config"));
    let config = std::env::var_os("XDG_CONFIG_HOME").map(PathBuf::from).or_else(home);
    config.unwrap_or_default().join("evrig/keys")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pair_is_for_its_owner_only_and_works_on_either_end() {
        let folder = tempfile::tempdir().unwrap();
        let made = pair(&folder.path().join("keys")).unwrap();
        for side in [&made.host, &made.agent] {
            assert_eq!(fs::metadata(side).unwrap().permissions().mode() & 0o777, 0o700);
            for file in [AUTHORITY, CERTIFICATE, KEY] {
                let mode = fs::metadata(side.join(file)).unwrap().permissions().mode();
                assert_eq!(mode & 0o777, 0o600, "{file}");
            }
        }
        Keys::read(&made.agent).unwrap().server().unwrap();
        Keys::read(&made.host).unwrap().client().unwrap();
        assert!(matches!(pair(&folder.path().join("keys")), Err(KeysError::Exists { .. })));
    }

    #[test]
    fn keys_that_others_can_read_or_that_do_not_belong_together_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let made = pair(folder.path()).unwrap();
        let key = made.host.join(KEY);
        fs::set_permissions(&key, fs::Permissions::from_mode(0o644)).unwrap();
        let said = Keys::read(&made.host).unwrap_err().to_string();
        assert!(said.contains("644") && said.contains("chmod"), "{said}");
        fs::set_permissions(&key, fs::Permissions::from_mode(0o600)).unwrap();
        fs::copy(made.agent.join(KEY), &key).unwrap();
        assert!(matches!(Keys::read(&made.host).unwrap().client(), Err(KeysError::Invalid { .. })));
        fs::write(&key, "no key").unwrap();
        assert!(matches!(Keys::read(&made.host), Err(KeysError::Invalid { .. })));
        let said = Keys::read(&folder.path().join("absent")).unwrap_err().to_string();
        assert!(said.contains("evrig pair"), "{said}");
    }
}
