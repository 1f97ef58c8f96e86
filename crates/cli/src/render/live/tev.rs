//! The viewer tev (<https://github.com/Tom94/tev>), reached by TCP.

use super::LiveImage;
use std::io;
use std::net::{TcpStream, ToSocketAddrs};
use std::str::FromStr;
use std::time::Duration;
use tev_client::{PacketCreateImage, PacketUpdateImage, TevClient};

/// The host and port at which tev listens by default.
const HOST: &str = "127.0.0.1";
const PORT: u16 = 14158;
/// The timeout of a connection, and of each write to tev.
const PATIENCE: Duration = Duration::from_secs(5);
/// The largest number of values in a packet.
const PACKET: usize = 1 << 24;

/// The host and port of a viewer.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Address {
    host: String,
    port: u16,
}

impl FromStr for Address {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = || format!("unknown viewer \"{text}\"; use tev, tev:HOST or tev:HOST:PORT");
        let (viewer, address) = text.split_once(':').unwrap_or((text, HOST));
        // An IPv6 host is in brackets.
        let (host, port) = match address.rsplit_once(':') {
            Some((host, port)) if !port.ends_with(']') => (host, port.parse().map_err(|_| wrong())?),
            _ => (address, PORT),
        };
        let host = host.strip_prefix('[').and_then(|host| host.strip_suffix(']')).unwrap_or(host);
        if viewer != "tev" || host.is_empty() || port == 0 {
            return Err(wrong());
        }
        Ok(Self { host: host.to_owned(), port })
    }
}

impl std::fmt::Display for Address {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self.host.contains(':') {
            true => write!(f, "tev at [{}]:{}", self.host, self.port),
            false => write!(f, "tev at {}:{}", self.host, self.port),
        }
    }
}

/// A connection to tev, which shows one image with layers named as in EXR files.
pub(super) struct Viewer {
    client: TevClient,
    address: Address,
    name: String,
    /// `true` if the image in tev has a layer of errors; `None` before it is created.
    has_error: Option<bool>,
}

impl Viewer {
    pub(super) fn connect(address: &Address) -> Result<Self, String> {
        let refused = |e: io::Error| {
            format!(
                "--view: cannot connect to {address} ({e}); start tev first, or state its address: --view tev:HOST:PORT"
            )
        };
        let mut last = io::Error::from(io::ErrorKind::AddrNotAvailable);
        for place in (address.host.as_str(), address.port).to_socket_addrs().map_err(refused)? {
            match TcpStream::connect_timeout(&place, PATIENCE) {
                Ok(socket) => {
                    socket.set_write_timeout(Some(PATIENCE)).map_err(refused)?;
                    let client = TevClient::wrap(socket);
                    return Ok(Self { client, address: address.clone(), name: String::new(), has_error: None });
                }
                Err(e) => last = e,
            }
        }
        Err(refused(last))
    }

    pub(super) fn address(&self) -> &Address {
        &self.address
    }

    /// Sets the name of the image in tev's list.
    pub(super) fn set_name(&mut self, scene: &str) {
        // A name ends at a zero byte.
        self.name = scene.replace('\0', "");
    }

    /// Sends an image with its layers; the first call creates the image in tev.
    pub(super) fn show(&mut self, image: &LiveImage) -> io::Result<()> {
        if self.has_error.is_none() {
            let [width, height] = image.size;
            let all = ["R", "G", "B", "count.Y", "error.Y"];
            let channel_names = &all[..if image.error.is_some() { 5 } else { 4 }];
            let (image_name, grab_focus) = (self.name.as_str(), true);
            self.client.send(PacketCreateImage { image_name, grab_focus, width, height, channel_names })?;
            self.has_error = Some(image.error.is_some());
        }
        let size = image.size;
        self.send(size, &["R", "G", "B"], image.radiance.as_flattened())?;
        self.send(size, &["count.Y"], &image.counts)?;
        if let (Some(true), Some(error)) = (self.has_error, &image.error) {
            self.send(size, &["error.Y"], error)?;
        }
        Ok(())
    }

    /// Sends the values of a layer, interleaved, in packets of whole rows.
    fn send(&mut self, [width, height]: [u32; 2], names: &[&str], values: &[f32]) -> io::Result<()> {
        let each = width as usize * names.len();
        let (offsets, strides): (Vec<u64>, Vec<u64>) = (0..names.len() as u64).map(|c| (c, names.len() as u64)).unzip();
        let rows = (PACKET / each).max(1);
        for (part, data) in values.chunks(rows * each).enumerate() {
            let y = (part * rows) as u32;
            self.client.send(PacketUpdateImage {
                image_name: &self.name,
                grab_focus: false,
                channel_names: names,
                channel_offsets: &offsets,
                channel_strides: &strides,
                x: 0,
                y,
                width,
                height: (data.len() / each).min((height - y) as usize) as u32,
                data,
            })?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_have_a_default_host_and_port() {
        let address = |text: &str| text.parse::<Address>().map(|a| a.to_string());
        assert_eq!(address("tev").unwrap(), "tev at 127.0.0.1:14158");
        assert_eq!(address("tev:studio").unwrap(), "tev at studio:14158");
        assert_eq!(address("tev:studio:99").unwrap(), "tev at studio:99");
        assert_eq!(address("tev:[::1]:99").unwrap(), "tev at [::1]:99");
        assert_eq!(address("tev:[::1]").unwrap(), "tev at [::1]:14158");
        for wrong in ["", "mpv", "tev:", "tev:a:", "tev:a:0", "tev:a:70000", "tev::9"] {
            assert!(address(wrong).unwrap_err().contains("use tev, tev:HOST"), "{wrong}");
        }
    }
}
