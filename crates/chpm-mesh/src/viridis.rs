//! Colours of numbers: equal steps of a number look equally large, also to those who do not tell red from green.

/// Stops of the colour map viridis (Smith and van der Walt), evenly apart.
const STOPS: [[u8; 3]; 9] = [
    [0x44, 0x01, 0x54],
    [0x47, 0x2d, 0x7b],
    [0x3b, 0x52, 0x8b],
    [0x2c, 0x72, 0x8e],
    [0x21, 0x91, 0x8c],
    [0x28, 0xae, 0x80],
    [0x5e, 0xc9, 0x62],
    [0xad, 0xdc, 0x30],
    [0xfd, 0xe7, 0x25],
];

/// A colour of viridis, from 0 to 1.
pub fn viridis(fraction: f64) -> [u8; 3] {
    let last = STOPS.len() - 1;
    let place = fraction.clamp(0.0, 1.0) * last as f64;
    let stop = (place as usize).min(last - 1);
    let part = place - stop as f64;
    let [low, high] = [stop, stop + 1].map(|stop| STOPS[stop].map(f64::from));
    [0, 1, 2].map(|channel| (low[channel] + part * (high[channel] - low[channel])).round() as u8)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_run_from_dark_to_light_through_the_stops() {
        assert_eq!([viridis(0.0), viridis(0.5), viridis(1.0)], [STOPS[0], STOPS[4], STOPS[8]]);
        let light = |step: u32| viridis(f64::from(step) / 64.0).iter().map(|c| u32::from(*c)).sum::<u32>();
        assert!((1..=64).all(|step| light(step) + 12 > light(step - 1)));
    }

    #[test]
    fn the_web_page_has_the_same_stops() {
        let page = include_str!("../../../web/view/colors.js");
        let stops: Vec<String> =
            STOPS.iter().map(|[r, g, b]| format!("\"#{r:02x}{g:02x}{b:02x}\"")).collect();
        assert!(page.contains(&stops.join(", ")), "{stops:?}");
    }
}
