//! The keys by which host and agent know each other: mutual TLS 1.3 under an authority of one's
//! own.
//!
//! `evrig pair` makes the authority, signs a certificate for each side and discards the authority's
//! key. Each side gets a directory with three PEM files.

use rustls::crypto::CryptoProvider;
use rustls::pki_types::pem::PemObject;
use rustls::pki_types::{CertificateDer, PrivateKeyDer, ServerName};
use rustls::server::WebPkiClientVerifier;
use rustls::{ClientConfig, RootCertStore, ServerConfig};
use std::fs;
use std::io;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// The name in every agent's certificate: who an agent is follows from its key, not from where it
/// is.
pub const AGENT_NAME: &str = "agent.evrig";
/// The certificate of the authority that signed both sides' certificates.
pub const AUTHORITY_FILE: &str = "authority.pem";
/// A side's certificate.
pub const CERTIFICATE_FILE: &str = "certificate.pem";
/// A side's private key.
pub const KEY_FILE: &str = "key.pem";

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
    /// A private key that others can read.
    #[error(
        "{} can be read by others (mode {mode:03o}, expected 600); run `chmod 600` on it, or \
         better pair anew",
        path.display()
    )]
    Open {
        /// The file.
        path: PathBuf,
        /// Its permissions.
        mode: u32,
    },
    /// A file does not hold what its name states.
    #[error("{}: {because}; pair anew with `evrig pair`", path.display())]
    Invalid {
        /// The file.
        path: PathBuf,
        /// Expected and found.
        because: String,
    },
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
    /// Reads a directory that `evrig pair` made.
    ///
    /// # Errors
    /// When a file is missing or wrong, or the private key can be read by others.
    pub fn read(directory: &Path) -> Result<Self, KeysError> {
        let key_path = directory.join(KEY_FILE);
        let metadata = fs::metadata(&key_path)
            .map_err(|source| KeysError::Io { path: key_path.clone(), source })?;
        let mode = metadata.permissions().mode() & 0o777;
        if mode & 0o077 != 0 {
            return Err(KeysError::Open { path: key_path, mode });
        }
        let key = PrivateKeyDer::from_pem_slice(&read(&key_path)?)
            .map_err(|error| wrong(&key_path, &error))?;
        let path = directory.join(AUTHORITY_FILE);
        let mut authority = RootCertStore::empty();
        for certificate in CertificateDer::pem_slice_iter(&read(&path)?) {
            let certificate = certificate.map_err(|error| wrong(&path, &error))?;
            authority.add(certificate).map_err(|error| wrong(&path, &error))?;
        }
        let path = directory.join(CERTIFICATE_FILE);
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
    const MAX_KEY_FILE_BYTES: u64 = 1 << 16;
    let io = |source| KeysError::Io { path: path.to_owned(), source };
    let found = fs::metadata(path).map_err(io)?.len();
    if found > MAX_KEY_FILE_BYTES {
        let because =
            format!("expected PEM text of at most {MAX_KEY_FILE_BYTES} bytes, found {found}");
        return Err(KeysError::Invalid { path: path.to_owned(), because });
    }
    fs::read(path).map_err(io)
}

fn wrong(path: &Path, error: &dyn std::fmt::Display) -> KeysError {
    KeysError::Invalid { path: path.to_owned(), because: error.to_string() }
}

/// Where a host looks for its keys unless the rig states a directory:
/// `$XDG_CONFIG_HOME/evrig/keys/host`, or `~/.config/evrig/keys/host`; the agent, `.../keys/agent`.
#[must_use]
pub fn default_directory() -> PathBuf {
    let home = || std::env::var_os("HOME").map(|home| PathBuf::from(home).join(".config"));
    let config = std::env::var_os("XDG_CONFIG_HOME").map(PathBuf::from).or_else(home);
    config.unwrap_or_default().join("evrig/keys")
}
