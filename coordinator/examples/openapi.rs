//! Writes the API's description, as docs/openapi.json keeps it, to standard output.

use std::io::Write;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut text = serde_json::to_string_pretty(&coordinator::http::openapi())?;
    text.push('\n');
    Ok(std::io::stdout().write_all(text.as_bytes())?)
}
