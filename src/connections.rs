//! The connections of a server: how many there are at a time, how long one may be idle, how much it may say before it is answered.

use anyhow::{Result, ensure};
use axum::Router;
use chpm_extmem::platform;
use hyper::server::conn::http1;
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
use std::io::{self, ErrorKind};
use std::sync::Arc;
use std::time::Duration;
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::Semaphore;
use tokio::time::sleep;
use tokio_io_timeout::TimeoutStream;

/// Descriptors of a connection: its socket, and the file that it is given.
const EACH: u64 = 2;
/// Descriptors besides: those that every program has, the listener, the runtime's, a folder that is looked into, a connection to be refused.
const OWN: u64 = 16;
/// Bytes of a request, at most. Browsers send a thousand.
const REQUEST: usize = 16 << 10;
/// Until descriptors are asked for again where there were none.
const PAUSE: Duration = Duration::from_millis(100);
/// Answer where no place is left.
const FULL: &[u8] = b"HTTP/1.1 503 Service Unavailable\r\nRetry-After: 1\r\nConnection: close\r\nContent-Type: text/plain\r\nContent-Length: 33\r\n\r\n\
    too many connections; come again\n";

/// Limits of connections.
#[derive(clap::Args, Clone, Copy, Debug)]
pub(crate) struct Limits {
    /// Connections at a time, or fewer where the process may not have that many files open; others are refused
    #[arg(long, value_name = "N", default_value_t = 256, value_parser = crate::number::count(1_u32..=65_536))]
    connections: u32,
    /// Seconds after which a connection is closed that asks nothing, or does not take what it is sent
    #[arg(long, value_name = "SECONDS", default_value_t = 15, value_parser = crate::number::count(1_u32..=3_600))]
    idle: u32,
}

impl Limits {
    /// How many connections there may be, so that descriptors never run out.
    pub(crate) fn places(self) -> Result<usize> {
        let open = platform::open_files()?;
        let fit = open.saturating_sub(OWN) / EACH;
        ensure!(
            fit > 0,
            "this process may have {open} files open at a time, and serving takes {}: raise the limit (`ulimit -n 256`)",
            OWN + EACH
        );
        Ok(u64::from(self.connections).min(fit) as usize)
    }

    fn idle(self) -> Duration {
        Duration::from_secs(self.idle.into())
    }
}

/// Answers whoever comes, at most so many at a time.
pub(crate) async fn serve(listener: TcpListener, router: Router, places: usize, limits: Limits) {
    let places = Arc::new(Semaphore::new(places));
    let answers = TowerToHyperService::new(router);
    let mut http = http1::Builder::new();
    // This one is about the time from one answer to the next request, too.
    http.timer(TokioTimer::new()).header_read_timeout(limits.idle()).max_buf_size(REQUEST);
    loop {
        let stream = match listener.accept().await {
            Ok((stream, _)) => stream,
            Err(error) if is_gone(&error) => continue,
            // Others of this system may have taken all that there are.
            Err(_) => {
                sleep(PAUSE).await;
                continue;
            }
        };
        let Ok(place) = Arc::clone(&places).try_acquire_owned() else {
            refuse(&stream);
            continue;
        };
        let mut stream = Box::pin(TimeoutStream::new(stream));
        stream.as_mut().set_write_timeout_pinned(Some(limits.idle()));
        let connection = http.serve_connection(TokioIo::new(stream), answers.clone());
        tokio::spawn(async move {
            // However it ends, it is over.
            let _ = connection.await;
            drop(place);
        });
    }
}

/// Whether it is one connection that failed.
fn is_gone(error: &io::Error) -> bool {
    let kinds = [ErrorKind::ConnectionAborted, ErrorKind::ConnectionReset, ErrorKind::ConnectionRefused];
    kinds.contains(&error.kind())
}

/// Nobody waits for it: what does not fit into its buffers is lost.
fn refuse(stream: &TcpStream) {
    let _ = stream.try_write(FULL);
    // What is unread when a connection is closed takes the answer with it.
    let _ = stream.try_read(&mut [0; REQUEST]);
}
