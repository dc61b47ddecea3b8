//! Which thread did what when: a record of a build's stages and tasks, for people who look where time goes and for replaying them
//! on other numbers of threads.

use chpm_extmem::process;
use std::fmt::Write as _;
use std::io;
use std::sync::atomic::{AtomicU32, Ordering::Relaxed};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

/// A recorder of stages and tasks, or nothing, which costs nothing. Each record takes 64 bytes, which no budget is charged.
#[derive(Clone, Debug, Default)]
pub struct Trace(Option<Arc<Recorder>>);

#[derive(Debug)]
struct Recorder {
    start: Instant,
    phases: AtomicU32,
    records: Mutex<Vec<Record>>,
}

#[derive(Clone, Copy, Debug)]
struct Record {
    name: &'static str,
    /// Microseconds are too coarse for small tasks.
    start_nanos: u64,
    nanos: u64,
    /// The same by the processor time of the thread, which waiting takes none of.
    busy_start: u64,
    busy: u64,
    /// Zero is the thread that asked for the build; then come those of its pool.
    thread: u32,
    /// None for a stage.
    phase: Option<u32>,
}

/// Tasks that depend on none of each other, but all on what was before them.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Phase<'a>(Option<(&'a Recorder, u32)>);

/// Work that lasts until it is dropped.
#[derive(Debug)]
pub(crate) struct Span<'a>(Option<(&'a Recorder, Record)>);

impl Trace {
    /// One that records, from now on.
    pub fn recording() -> Self {
        let recorder =
            Recorder { start: Instant::now(), phases: AtomicU32::new(0), records: Mutex::default() };
        Trace(Some(Arc::new(recorder)))
    }

    /// Begins a stage.
    pub(crate) fn stage(&self, name: &'static str) -> Span<'_> {
        Span::begin(self.0.as_deref(), name, None)
    }

    /// Begins tasks beside each other.
    pub(crate) fn phase(&self) -> Phase<'_> {
        Phase(self.0.as_deref().map(|recorder| (recorder, recorder.phases.fetch_add(1, Relaxed))))
    }

    /// Begins a task that nothing is beside.
    pub(crate) fn task(&self, name: &'static str) -> Span<'_> {
        self.phase().task(name)
    }

    /// Writes what was recorded, in Chrome's trace event format: a JSON array of complete events, times in microseconds: `ts` and `dur`
    /// by the clock, `tts` and `tdur` by the processor time of the thread. The events of one `phase` are independent of each other.
    ///
    /// # Errors
    /// Those of `out`.
    pub fn write(&self, out: &mut impl io::Write) -> io::Result<()> {
        let mut records = self.0.as_ref().map(|recorder| recorder.records().clone()).unwrap_or_default();
        // A stage comes before its tasks.
        records.sort_unstable_by_key(|record| (record.start_nanos, record.phase.is_some(), record.thread));
        let mut line = String::from("[");
        for (index, record) in records.iter().enumerate() {
            line.push_str(if index == 0 { "\n" } else { ",\n" });
            record.describe(&mut line);
            out.write_all(line.as_bytes())?;
            line.clear();
        }
        line.push_str("\n]\n");
        out.write_all(line.as_bytes())
    }
}

/// Resources are the same if they record into the same place.
impl PartialEq for Trace {
    fn eq(&self, other: &Self) -> bool {
        self.0.as_ref().map(Arc::as_ptr) == other.0.as_ref().map(Arc::as_ptr)
    }
}

impl Recorder {
    fn records(&self) -> std::sync::MutexGuard<'_, Vec<Record>> {
        self.records.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn nanos(&self) -> u64 {
        self.start.elapsed().as_nanos() as u64
    }

    /// Processor time of this thread; by the clock where the system does not tell.
    fn busy(&self) -> u64 {
        process::thread_time().map_or_else(|| self.nanos(), |time| time.as_nanos() as u64)
    }
}

impl Record {
    fn describe(&self, line: &mut String) {
        let Record { name, thread, phase, .. } = self;
        let kind = if phase.is_some() { "task" } else { "stage" };
        let times = [self.start_nanos, self.nanos, self.busy_start, self.busy];
        let [start, duration, busy_start, busy] = times.map(|n| format!("{}.{:03}", n / 1000, n % 1000));
        // A String takes all that is written.
        let _ = write!(
            line,
            r#"{{"name":"{name}","cat":"{kind}","ph":"X","ts":{start},"dur":{duration},"tts":{busy_start},"tdur":{busy},"pid":1,"tid":{thread}"#
        );
        if let Some(phase) = phase {
            let _ = write!(line, r#","args":{{"phase":{phase}}}"#);
        }
        line.push('}');
    }
}

impl<'a> Phase<'a> {
    /// Begins a task on this thread.
    pub(crate) fn task(&self, name: &'static str) -> Span<'a> {
        Span::begin(self.0.map(|(recorder, _)| recorder), name, self.0.map(|(_, phase)| phase))
    }
}

impl<'a> Span<'a> {
    fn begin(recorder: Option<&'a Recorder>, name: &'static str, phase: Option<u32>) -> Self {
        Span(recorder.map(|recorder| {
            let thread = rayon::current_thread_index().map_or(0, |index| index as u32 + 1);
            let (start_nanos, busy_start) = (recorder.nanos(), recorder.busy());
            (recorder, Record { name, start_nanos, nanos: 0, busy_start, busy: 0, thread, phase })
        }))
    }
}

impl Drop for Span<'_> {
    fn drop(&mut self) {
        if let Some((recorder, mut record)) = self.0.take() {
            record.nanos = recorder.nanos() - record.start_nanos;
            record.busy = recorder.busy() - record.busy_start;
            recorder.records().push(record);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stages_and_tasks_are_written_as_they_began() {
        let trace = Trace::recording();
        let stage = trace.stage("ingest");
        let phase = trace.phase();
        drop(phase.task("slice"));
        drop(trace.phase().task("other"));
        drop(stage);
        let mut text = Vec::new();
        trace.write(&mut text).unwrap();
        let text = String::from_utf8(text).unwrap();
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!((lines[0], lines[4], lines.len()), ("[", "]", 5));
        assert!(lines[1].starts_with(r#"{"name":"ingest","cat":"stage","ph":"X","ts":"#), "{text}");
        assert!(lines[1].ends_with(r#","pid":1,"tid":0},"#), "{text}");
        assert!(lines[2].contains("slice") && lines[2].ends_with(r#""args":{"phase":0}},"#), "{text}");
        assert!(lines[3].contains("other") && lines[3].ends_with(r#""args":{"phase":1}}"#), "{text}");
    }

    #[test]
    fn nothing_is_recorded_unasked() {
        let trace = Trace::default();
        drop((trace.stage("ingest"), trace.phase().task("slice")));
        let mut text = Vec::new();
        trace.write(&mut text).unwrap();
        assert_eq!(text, b"[\n]\n");
    }
}
