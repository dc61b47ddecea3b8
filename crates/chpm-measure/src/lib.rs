//! Deviation, cracks and layout misses; shares no code with the simplifier that it judges.
