//! `chpm serve`: files and the page that shows them, to a browser.

use super::{Verdict, open, stdout};
use crate::connections::{self, Limits};
use crate::web::{FILES, Given, PAGE, page_for};
use anyhow::{Context, Result, ensure};
use axum::Router;
use axum::body::Body;
use axum::extract::{Request, State};
use axum::http::request::Parts;
use axum::http::{self, HeaderMap, HeaderValue, Method, StatusCode, header};
use axum::response::{Html, IntoResponse, Redirect, Response};
use chpm_extmem::platform;
use chpm_format::volume;
use percent_encoding::{NON_ALPHANUMERIC, percent_decode_str, utf8_percent_encode};
use std::borrow::Cow;
use std::fs;
use std::io::Write;
use std::net::{IpAddr, SocketAddr, TcpListener};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};
use tower_http::services::ServeFile;
use xxhash_rust::xxh3::xxh3_64;

/// Threads that read files, beside the one that answers.
const READERS: usize = 8;
/// How often an answer is begun before a file counts as one that never stays.
const TRIES: u32 = 16;

/// Arguments of `chpm serve`.
#[derive(clap::Args, Debug)]
pub(crate) struct Args {
    /// A .chpm file, or a folder of them
    path: PathBuf,
    /// Port to listen at; 0 takes any that is free
    #[arg(long, value_name = "PORT", default_value_t = 8017)]
    port: u16,
    /// Address to listen at; whoever reaches another one than the default can read the files
    #[arg(long, value_name = "ADDRESS", default_value = "127.0.0.1")]
    address: IpAddr,
    /// Show a list of a folder's .chpm files
    #[arg(long)]
    list: bool,
    #[command(flatten)]
    limits: Limits,
}

/// Files that may be read.
struct Served {
    /// The folder, without links.
    folder: PathBuf,
    /// The only file, where one was named.
    only: Option<String>,
    list: bool,
    /// For this machine alone.
    is_local: bool,
    /// The page that was asked for last, by the version of its model.
    last: Mutex<Option<(HeaderValue, String)>>,
}

/// Serves until it is stopped.
pub(crate) fn run(args: &Args) -> Result<Verdict> {
    let served = Arc::new(Served::new(args)?);
    let places = args.limits.places()?;
    let address = SocketAddr::new(args.address, args.port);
    let listener = TcpListener::bind(address)
        .with_context(|| format!("cannot listen at {address}; choose another --port, or 0 for any"))?;
    listener.set_nonblocking(true)?;
    let address = listener.local_addr()?;
    let mut out = stdout();
    let page = served.only.as_ref().map_or(String::new(), |name| page_of(name));
    writeln!(out, "http://{address}/{page}")?;
    if !args.address.is_loopback() {
        writeln!(out, "not only this machine: whoever reaches {} can read these files", args.address)?;
    }
    writeln!(out, "Ctrl-C ends it")?;
    out.flush()?;
    drop(out);

    let runtime = tokio::runtime::Builder::new_current_thread()
        .max_blocking_threads(READERS)
        .enable_io()
        .enable_time()
        .build()?;
    runtime.block_on(async {
        let listener = tokio::net::TcpListener::from_std(listener)?;
        let router = Router::new().fallback(answer).with_state(served);
        connections::serve(listener, router, places, args.limits).await;
        Ok(Verdict::Good)
    })
}

impl Served {
    fn new(args: &Args) -> Result<Self> {
        let path =
            fs::canonicalize(&args.path).with_context(|| format!("cannot find '{}'", args.path.display()))?;
        let is_local = args.address.is_loopback();
        if path.is_dir() {
            return Ok(Served {
                folder: path,
                only: None,
                list: args.list,
                is_local,
                last: Mutex::default(),
            });
        }
        ensure!(!args.list, "--list is for a folder, and '{}' is a file", args.path.display());
        open(&path)?;
        let name = path.file_name().and_then(|name| name.to_str());
        let name = name.with_context(|| format!("the name '{}' is no text", path.display()))?.to_owned();
        let folder = path.parent().unwrap_or(Path::new("/")).to_owned();
        Ok(Served { folder, only: Some(name), list: false, is_local, last: Mutex::default() })
    }

    /// A model, or a volume of one, also if the way there has links, but not if it leads out of the folder.
    fn find(&self, path: &str) -> Option<PathBuf> {
        self.model(path).or_else(|| self.volume(path))
    }

    /// The only file, whatever its name, or a .chpm file in the folder.
    fn model(&self, path: &str) -> Option<PathBuf> {
        let may_be = match &self.only {
            Some(only) => only == path,
            None => {
                let extension = Path::new(path).extension();
                let is_hidden = path.split('/').any(|part| part.starts_with('.'));
                !is_hidden && extension.is_some_and(|extension| extension.eq_ignore_ascii_case("chpm"))
            }
        };
        if may_be { self.within(&self.folder.join(path)) } else { None }
    }

    /// The volume of a model that has this name: `a.0001.pages` is one of `a.chpm`, or of `a`.
    fn volume(&self, path: &str) -> Option<PathBuf> {
        let (stem, digits) = path.strip_suffix(".pages")?.rsplit_once('.')?;
        let number = digits.parse().ok()?;
        let models = [format!("{stem}.chpm"), stem.to_owned()];
        let mut named =
            models.iter().filter(|model| volume::path(Path::new(model), number) == Path::new(path));
        named.find_map(|model| self.within(&volume::path(&self.model(model)?, number)))
    }

    /// The file at a path, without links, if it is in the folder.
    fn within(&self, path: &Path) -> Option<PathBuf> {
        let found = fs::canonicalize(path).ok()?;
        (found.starts_with(&self.folder) && found.is_file()).then_some(found)
    }

    /// The page of the model that its address names, as that is seen best; nothing where there is none, or it cannot be read, which the page will find.
    fn page(&self, query: Option<&str>) -> Option<String> {
        let name = query?.split('&').find_map(|pair| pair.strip_prefix("file="))?;
        let name = percent_decode_str(name).decode_utf8().ok()?;
        let found = self.find(&name)?;
        let (tag, _) = version(&found).ok()?;
        let mut last = self.last.lock().unwrap_or_else(|held| held.into_inner());
        if let Some((_, page)) = last.as_ref().filter(|(known, _)| *known == tag) {
            return Some(page.clone());
        }
        let page = page_for(&open(&found).ok()?, &Given::default()).ok()?;
        *last = Some((tag, page.clone()));
        Some(page)
    }

    /// Paths of the .chpm files at the top of the folder.
    fn names(&self) -> Vec<String> {
        let entries = fs::read_dir(&self.folder).into_iter().flatten().flatten();
        let names = entries.filter_map(|entry| entry.file_name().into_string().ok());
        let mut names: Vec<String> = names.filter(|name| self.model(name).is_some()).collect();
        names.sort_unstable();
        names
    }
}

/// The page's address for a file.
fn page_of(name: &str) -> String {
    format!("{PAGE}?file={}", utf8_percent_encode(name, NON_ALPHANUMERIC))
}

/// A page of another origin may give its own name the address of this machine; then it asks by that name.
fn names_this_machine(request: &Request) -> bool {
    let host = request.headers().get(header::HOST).and_then(|host| host.to_str().ok()).unwrap_or_default();
    let name = match host.rsplit_once(':') {
        Some((name, port)) if port.parse::<u16>().is_ok() => name,
        _ => host,
    };
    // A name may end in a dot, so that nothing is put behind it.
    let name = name.strip_suffix('.').unwrap_or(name);
    let address = name.trim_start_matches('[').trim_end_matches(']').parse::<IpAddr>();
    name.eq_ignore_ascii_case("localhost") || address.is_ok_and(|address| address.is_loopback())
}

async fn answer(State(served): State<Arc<Served>>, mut request: Request) -> Response {
    if request.method() != Method::GET && request.method() != Method::HEAD {
        return (StatusCode::METHOD_NOT_ALLOWED, [(header::ALLOW, "GET, HEAD")]).into_response();
    }
    if served.is_local && !names_this_machine(&request) {
        return (StatusCode::FORBIDDEN, "this is served to this machine, by its address or as localhost\n")
            .into_response();
    }
    let Ok(path) = percent_decode_str(request.uri().path().trim_start_matches('/')).decode_utf8() else {
        return StatusCode::NOT_FOUND.into_response();
    };
    let path = path.into_owned();
    if path.is_empty() {
        return front(&served);
    }
    if request.method() == Method::HEAD {
        // A range is one of what a GET answers with (RFC 9110, 14.2).
        request.headers_mut().remove(header::RANGE);
    }
    let query = request.uri().query().map(str::to_owned);
    if path == PAGE
        && let Some(page) = page_as_seen(Arc::clone(&served), query).await
    {
        return own(page.into(), "text/html; charset=utf-8", request.headers());
    }
    if let Some(file) = FILES.iter().find(|file| file.path == path) {
        return own(file.text.into(), file.media_type, request.headers());
    }
    file(&served, &path, &request.into_parts().0).await
}

/// A file, or why it is not sent. One that takes its place meanwhile is not sent under its tag: all begins anew with that one.
async fn file(served: &Served, path: &str, asked: &Parts) -> Response {
    let unreadable = || (StatusCode::INTERNAL_SERVER_ERROR, "the file cannot be read\n").into_response();
    for _ in 0..TRIES {
        let Some(found) = served.find(path) else {
            return (StatusCode::NOT_FOUND, "no .chpm file of that name is served\n").into_response();
        };
        let Ok((tag, len)) = version(&found) else { return unreadable() };
        let mut request = http::Request::from_parts(asked.clone(), ());
        let mut answer = match settled(request.headers_mut(), &tag, len) {
            Some(status) => status.into_response(),
            None => match ServeFile::new(&found).try_call(request).await {
                Ok(answer) => answer.map(Body::new),
                Err(_) => return unreadable(),
            },
        };
        if version(&found).is_ok_and(|(now, _)| now == tag) {
            answer.headers_mut().insert(header::ETAG, tag);
            // To be kept, and asked for again by its tag.
            answer.headers_mut().insert(header::CACHE_CONTROL, HeaderValue::from_static("no-cache"));
            // Pages of other origins may not read what is on this machine.
            answer
                .headers_mut()
                .insert("Cross-Origin-Resource-Policy", HeaderValue::from_static("same-origin"));
            return answer;
        }
    }
    (StatusCode::SERVICE_UNAVAILABLE, "the file is being replaced again and again: ask later\n")
        .into_response()
}

/// The page of a model, made beside the thread that answers: pages of the model are read for it.
async fn page_as_seen(served: Arc<Served>, query: Option<String>) -> Option<String> {
    tokio::task::spawn_blocking(move || served.page(query.as_deref())).await.ok().flatten()
}

/// A file of the page, unless it is known already. A newer program has newer ones at the same address.
fn own(text: Cow<'static, str>, media_type: &'static str, asked: &HeaderMap) -> Response {
    let tag = format!("\"{:016x}\"", xxh3_64(text.as_bytes()));
    let is_known = asked.get(header::IF_NONE_MATCH).is_some_and(|known| names(known, tag.as_bytes()));
    let headers = [
        (header::CONTENT_TYPE, media_type),
        (header::CACHE_CONTROL, "no-cache"),
        (header::ETAG, tag.as_str()),
    ];
    match is_known {
        true => (StatusCode::NOT_MODIFIED, headers).into_response(),
        false => (headers, text).into_response(),
    }
}

/// Whether a list of tags has this one.
fn names(list: &HeaderValue, tag: &[u8]) -> bool {
    let list = list.to_str().unwrap_or_default();
    list.split(',').map(str::trim).any(|one| one == "*" || one.trim_start_matches("W/").as_bytes() == tag)
}

/// Tag that tells a file from any that had its name before, also within a second; and its length.
fn version(path: &Path) -> Result<(HeaderValue, u64)> {
    let found = fs::metadata(path)?;
    let (number, (seconds, nanoseconds)) = (platform::id_at(path)?.number, platform::modified(&found));
    let tag = format!("\"{number:x}-{:x}-{seconds:x}.{nanoseconds:x}\"", found.len());
    Ok((HeaderValue::from_str(&tag)?, found.len()))
}

/// Answer to those headers that `ServeFile` does not know of (RFC 9110, 13 and 14), for the file of this tag and length; nothing where it
/// has only to serve what is left of them.
fn settled(headers: &mut HeaderMap, tag: &HeaderValue, len: u64) -> Option<StatusCode> {
    let names = |value: &HeaderValue| names(value, tag.as_bytes());
    if let Some(known) = headers.get(header::IF_MATCH) {
        if !names(known) {
            return Some(StatusCode::PRECONDITION_FAILED);
        }
        headers.remove(header::IF_UNMODIFIED_SINCE);
    }
    if let Some(known) = headers.get(header::IF_NONE_MATCH) {
        if names(known) {
            return Some(StatusCode::NOT_MODIFIED);
        }
        headers.remove(header::IF_MODIFIED_SINCE);
    }
    // A part is of use only beside parts of the same file.
    let is_other = headers.get(header::IF_RANGE).is_some_and(|of| of != tag);
    let range = headers.get(header::RANGE)?.to_str().unwrap_or_default().to_owned();
    let (unit, ranges) = range.split_once('=').unwrap_or_default();
    let mut ranges = ranges.split(',').map(str::trim).filter(|range| !range.is_empty());
    // Who asks for several ranges at once may be given all of the file.
    let one = ranges.next().filter(|_| ranges.next().is_none());
    match one.filter(|_| unit.trim().eq_ignore_ascii_case("bytes") && !is_other) {
        Some(range) => {
            let range = match range.split_once('-') {
                Some((first, last)) if is_beyond(last, len) => {
                    format!("{}-", if first.is_empty() { "0" } else { first })
                }
                _ => range.to_owned(),
            };
            headers.insert(header::RANGE, HeaderValue::from_str(&format!("bytes={range}")).ok()?);
        }
        None => {
            headers.remove(header::RANGE);
        }
    }
    None
}

/// Whether digits are a number above `len`, though it may be beyond 64 bits.
fn is_beyond(digits: &str, len: u64) -> bool {
    let is_number = !digits.is_empty() && digits.bytes().all(|byte| byte.is_ascii_digit());
    is_number && digits.parse().unwrap_or(u64::MAX) > len
}

/// Page at the root: the only file's page, a list if that was asked for, else the page without a model.
fn front(served: &Served) -> Response {
    if let Some(only) = &served.only {
        return Redirect::temporary(&page_of(only)).into_response();
    }
    if !served.list {
        return Redirect::temporary(PAGE).into_response();
    }
    let rows = served.names().into_iter().map(|name| {
        let escaped = name.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;");
        format!("<li><a href=\"{}\">{escaped}</a></li>", page_of(&name))
    });
    let rows: String = rows.collect();
    Html(format!("<!doctype html><meta charset=\"utf-8\"><title>chpm</title><ul>{rows}</ul>")).into_response()
}
