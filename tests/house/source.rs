//! Enough of Rust's syntax to see which module a source file is, and what it names.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// A token; comments, numbers' details and white space are gone.
#[derive(Debug, Clone, PartialEq)]
pub enum Token {
    Word(String),
    Text(String),
    Sign(char),
}

impl Token {
    pub fn is_word(&self, word: &str) -> bool {
        matches!(self, Token::Word(w) if w == word)
    }
    pub fn word(&self) -> Option<&str> {
        if let Token::Word(w) = self { Some(w) } else { None }
    }
    pub fn is_sign(&self, sign: char) -> bool {
        *self == Token::Sign(sign)
    }
}

/// A token and its line, counted from 1.
pub type Placed = (Token, usize);

/// Splits `text`, which must be Rust that compiles.
pub fn tokens(text: &str) -> Vec<Placed> {
    let chars: Vec<char> = text.chars().collect();
    let (mut at, mut line, mut out) = (0, 1, Vec::new());
    let peek = |at: usize| chars.get(at).copied().unwrap_or('\0');
    while at < chars.len() {
        let start = at;
        let token = match chars[at] {
            '/' if peek(at + 1) == '/' => {
                at += chars[at..].iter().take_while(|&&c| c != '\n').count();
                None
            }
            '/' if peek(at + 1) == '*' => {
                at = end_of_comment(&chars, at);
                None
            }
            '"' => {
                at = end_of_text(&chars, at + 1);
                Some(Token::Text(chars[start + 1..at - 1].iter().collect()))
            }
            '\'' => {
                at = end_of_quote(&chars, at);
                None
            }
            c if c.is_alphanumeric() || c == '_' => {
                at += chars[at..].iter().take_while(|c| c.is_alphanumeric() || **c == '_').count();
                let word: String = chars[start..at].iter().collect();
                let hashes = chars[at..].iter().take_while(|&&c| c == '#').count();
                let is_raw = matches!(word.as_str(), "r" | "br" | "cr") && peek(at + hashes) == '"';
                if is_raw {
                    at = end_of_raw(&chars, at + hashes + 1, hashes);
                    None
                } else {
                    Some(Token::Word(word))
                }
            }
            c if c.is_whitespace() => {
                at += 1;
                None
            }
            c => {
                at += 1;
                Some(Token::Sign(c))
            }
        };
        out.extend(token.map(|t| (t, line)));
        line += chars[start..at].iter().filter(|&&c| c == '\n').count();
    }
    out
}

fn end_of_comment(chars: &[char], mut at: usize) -> usize {
    let mut depth = 0;
    loop {
        match (chars[at], chars.get(at + 1)) {
            ('/', Some('*')) => (depth, at) = (depth + 1, at + 2),
            ('*', Some('/')) => (depth, at) = (depth - 1, at + 2),
            _ => at += 1,
        }
        if depth == 0 || at >= chars.len() {
            return at;
        }
    }
}

fn end_of_text(chars: &[char], mut at: usize) -> usize {
    while chars[at] != '"' {
        at += if chars[at] == '\\' { 2 } else { 1 };
    }
    at + 1
}

fn end_of_raw(chars: &[char], mut at: usize, hashes: usize) -> usize {
    while chars[at] != '"' || !chars[at + 1..].iter().take(hashes).all(|&c| c == '#') {
        at += 1;
    }
    at + 1 + hashes
}

/// A character, or just the quote of a lifetime.
fn end_of_quote(chars: &[char], at: usize) -> usize {
    let is_char = chars.get(at + 1) == Some(&'\\') || chars.get(at + 2) == Some(&'\'');
    if !is_char {
        return at + 1;
    }
    let mut end = at + if chars[at + 1] == '\\' { 3 } else { 2 };
    while chars[end] != '\'' {
        end += 1;
    }
    end + 1
}

/// A module written in a file: its path from the crate's root, and all its tokens but those of
/// modules inside of it.
#[derive(Debug, Default)]
pub struct Module {
    pub file: PathBuf,
    pub path: Vec<String>,
    pub tokens: Vec<Placed>,
}

/// All modules below `root` (`lib.rs` or `main.rs`), found by their declarations.
pub fn modules(root: &Path) -> Vec<Module> {
    let mut out = Vec::new();
    let folder = root.parent().unwrap().to_path_buf();
    let mut files = vec![(root.to_path_buf(), folder, Vec::new())];
    while let Some((file, folder, path)) = files.pop() {
        let text = std::fs::read_to_string(&file).unwrap_or_else(|e| panic!("{}: {e}", file.display()));
        let mut split = Split { file: &file, tokens: &tokens(&text), out: &mut out, files: &mut files };
        split.module(0, &folder, path);
    }
    out
}

struct Split<'a> {
    file: &'a Path,
    tokens: &'a [Placed],
    out: &'a mut Vec<Module>,
    files: &'a mut Vec<(PathBuf, PathBuf, Vec<String>)>,
}

impl Split<'_> {
    /// Takes the tokens of a module from `at` to its closing brace; returns where that is.
    /// `folder`: where the files of its modules are.
    fn module(&mut self, mut at: usize, folder: &Path, path: Vec<String>) -> usize {
        let mut module = Module { file: self.file.to_path_buf(), path, tokens: Vec::new() };
        let (mut depth, mut named_file) = (0, None);
        while at < self.tokens.len() {
            let token = &self.tokens[at].0;
            let following = |n: usize| self.tokens.get(at + n).map(|t| &t.0);
            let is_path = token.is_word("path") && following(1).is_some_and(|t| t.is_sign('='));
            if let (true, Some(Token::Text(file))) = (is_path, following(2)) {
                named_file = Some(self.file.parent().unwrap().join(file));
            }
            let child = following(1).and_then(Token::word).filter(|_| token.is_word("mod"));
            if let (Some(name), Some(Token::Sign(';'))) = (child, following(2)) {
                self.declare(folder, &module.path, name, named_file.take());
                at += 3;
                continue;
            }
            if let (Some(name), Some(Token::Sign('{'))) = (child, following(2)) {
                let inner = module.path.iter().cloned().chain([name.to_owned()]).collect();
                at = self.module(at + 3, &folder.join(name), inner) + 1;
                continue;
            }
            depth += i32::from(token.is_sign('{')) - i32::from(token.is_sign('}'));
            if depth < 0 {
                break;
            }
            module.tokens.push(self.tokens[at].clone());
            at += 1;
        }
        self.out.push(module);
        at
    }

    fn declare(&mut self, folder: &Path, parent: &[String], name: &str, named_file: Option<PathBuf>) {
        let path = parent.iter().cloned().chain([name.to_owned()]).collect();
        let beside = folder.join(format!("{name}.rs"));
        let (file, below) = match named_file {
            Some(file) => (file.clone(), file.with_extension("")),
            None if beside.exists() => (beside, folder.join(name)),
            None => (folder.join(name).join("mod.rs"), folder.join(name)),
        };
        self.files.push((file, below, path));
    }
}

/// What the crate's root gives names of its own: name to room.
pub type Reexports = BTreeMap<String, String>;

/// Reads `pub use room::...::{Name, ...};` of `lib.rs`.
pub fn reexports(lib: &Module) -> Reexports {
    let words: Vec<&Token> = lib.tokens.iter().map(|t| &t.0).collect();
    let mut out = Reexports::new();
    for statement in words.split(|t| t.is_sign(';')) {
        // What is left of `pub mod room` comes before.
        let at = statement.iter().position(|t| t.is_word("use"));
        if let Some([Token::Word(room), names @ ..]) = at.map(|at| &statement[at + 1..]) {
            out.extend(names.iter().filter_map(|t| t.word()).map(|name| (name.to_owned(), room.clone())));
        }
    }
    out
}

/// The names directly below the crate's root that `module` mentions, by `crate::` or by as many
/// `super::` as lead there, each with its line. `*` is a name here.
pub fn names_at_root(module: &Module) -> Vec<(String, usize)> {
    let t = &module.tokens;
    let step = |at: usize| t.len() > at + 2 && t[at].0.is_sign(':') && t[at + 1].0.is_sign(':');
    let mut out = Vec::new();
    let mut at = 0;
    while at < t.len() {
        let mut above = None;
        if t[at].0.is_word("crate") && step(at + 1) {
            (above, at) = (Some(usize::MAX), at + 3);
        } else {
            while t.get(at).is_some_and(|t| t.0.is_word("super")) && step(at + 1) {
                (above, at) = (Some(above.unwrap_or(0) + 1), at + 3);
            }
        }
        match above {
            Some(levels) if levels >= module.path.len() => out.extend(first_names(&t[at..])),
            Some(_) => {}
            None => at += 1,
        }
    }
    out
}

/// The names directly below a room that `module` mentions, in whatever way the room itself is come by, each with its
/// line. `*` is a name here, and stands for a room that is given another name.
pub fn names_below(module: &Module, room: &str) -> Vec<(String, usize)> {
    let t = &module.tokens;
    let sign = |at: usize, sign: char| t.get(at).is_some_and(|t| t.0.is_sign(sign));
    let mut out = Vec::new();
    for at in (0..t.len()).filter(|&at| t[at].0.is_word(room)) {
        if sign(at + 1, ':') && sign(at + 2, ':') {
            out.extend(first_names(&t[at + 3..]));
        } else if t.get(at + 1).is_some_and(|t| t.0.is_word("as"))
            && at > 0
            && [':', '{', ','].iter().any(|&c| sign(at - 1, c))
        {
            out.push(("*".to_owned(), t[at].1));
        }
    }
    out
}

/// The first name of a path, or those of a group in braces.
fn first_names(t: &[Placed]) -> Vec<(String, usize)> {
    let name = |(token, line): &Placed| match token {
        Token::Word(w) => Some((w.clone(), *line)),
        Token::Sign('*') => Some(("*".to_owned(), *line)),
        _ => None,
    };
    if !t.first().is_some_and(|t| t.0.is_sign('{')) {
        return t.first().and_then(name).into_iter().collect();
    }
    let (mut depth, mut fresh, mut out) = (0, true, Vec::new());
    for placed in t {
        match placed.0 {
            Token::Sign('{') => depth += 1,
            Token::Sign('}') => depth -= 1,
            Token::Sign(',') if depth == 1 => fresh = true,
            _ if depth == 1 && fresh => {
                out.extend(name(placed));
                fresh = false;
            }
            _ => {}
        }
        if depth == 0 {
            break;
        }
    }
    out
}
