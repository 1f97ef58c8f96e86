"""The places of Rust code that can be mutated, with names that survive moves of files and reformatting."""

import fnmatch
import re
from collections import Counter, defaultdict
from dataclasses import dataclass
from pathlib import Path

import tree_sitter
import tree_sitter_rust

PARSER = tree_sitter.Parser(tree_sitter.Language(tree_sitter_rust.language()))

OPERATORS = {
    "+": ["-", "*"], "-": ["+", "/"], "*": ["/", "+"], "/": ["*", "%"], "%": ["/", "+"],
    "<": ["<=", ">"], "<=": ["<", ">"], ">": [">=", "<"], ">=": [">", "<"], "==": ["!="], "!=": ["=="],
    "&&": ["||"], "||": ["&&"], "&": ["|"], "|": ["&"], "^": ["|"], "<<": [">>"], ">>": ["<<"],
}
# A switch inside these would be evaluated by the compiler, or is no expression.
CONSTANT = {
    "const_item", "static_item", "const_block", "array_type", "type_arguments", "type_parameters", "attribute_item",
    "inner_attribute_item", "macro_invocation", "macro_definition", "enum_item", "where_clause", "parameters",
}
# A number is named by the expression around it.
AROUND = {
    "unary_expression", "parenthesized_expression", "reference_expression", "type_cast_expression", "arguments", "array_expression",
    "tuple_expression", "range_expression", "index_expression", "binary_expression", "field_initializer", "let_declaration",
    "call_expression", "match_arm", "assignment_expression", "compound_assignment_expr", "field_expression", "return_expression",
}
WHOLE = {"string_literal", "raw_string_literal", "char_literal"}
COMMENTS = {"line_comment", "block_comment"}
INTEGERS = {p + b for p in "iu" for b in ("8", "16", "32", "64", "128", "size")}
NAMES_OF_TEXT = {"fmt", "name", "describe", "main"}


@dataclass
class Site:
    """One mutant: where it stands, what replaces what, and its name."""

    crate: str
    file: str
    function: str
    kind: str
    original: str
    mutated: str
    start: int
    end: int
    # How it is planted: "expression", "statement" (switched off) or "body" (returns early).
    form: str
    code: str
    ordinal: int = 0

    def identity(self):
        return (self.crate, self.function, self.kind, self.original, self.mutated, str(self.ordinal))


def leaves(node):
    if node.type in COMMENTS:
        return
    if node.child_count == 0 or node.type in WHOLE:
        yield node
    else:
        for child in node.children:
            yield from leaves(child)


def spaced(node):
    """Whether rustfmt writes spaces around this operator."""
    return not node.is_named and node.parent.type in {
        "binary_expression", "compound_assignment_expr", "assignment_expression", "let_declaration", "match_arm"
    }


def text(node, change=None):
    """A node's text with one spacing; with a change `(part, code)` also the changed text, both cut some way from it."""
    tokens = list(leaves(node))
    tokens = [t for i, t in enumerate(tokens) if t.text != b"," or i + 1 == len(tokens) or tokens[i + 1].text not in (b")", b"]", b"}")]
    parts = ["", "", ""]
    for i, token in enumerate(tokens):
        own = re.sub(r"\s", " ", token.text.decode())
        part = 0
        if change:
            part = 1 if change[0].start_byte <= token.start_byte < change[0].end_byte else 2 * (token.start_byte >= change[0].end_byte)
        if i > 0:
            before = tokens[i - 1].text.decode()
            words = re.search(r"\w$", before) and re.match(r"[\w'\"]", own)
            if spaced(token) and own != ";" or spaced(tokens[i - 1]) or before in (",", ";") or words:
                # Of a removed `!` no space is left.
                parts[0 if part == 1 else part] += " "
        parts[part] += own
    if not change:
        return parts[0] if len(parts[0]) <= 160 else parts[0][:160] + "…"
    head = parts[0] if len(parts[0]) <= 60 else "…" + parts[0][-60:]
    tail = parts[2] if len(parts[2]) <= 60 else parts[2][:60] + "…"
    return head + parts[1] + tail, head + change[1] + tail


def values_of(kind):
    """Values of a return type, as cargo-mutants replaces bodies by them."""
    kind = re.sub(r"\s+", " ", kind)
    if kind in ("", "()"):
        return [("()", "")]
    if kind == "!" or kind.startswith(("&", "impl ", "dyn ", "*")):
        return []
    if kind == "bool":
        return [("true", "true"), ("false", "false")]
    if kind in INTEGERS:
        return [("0", "0"), ("1", "1")]
    if kind in ("f32", "f64"):
        return [("0.0", "0.0"), ("1.0", "1.0")]
    if kind.startswith("Option<"):
        return [("None", "None")]
    if re.match(r"(\w+::)*Result<\(\)", kind):
        return [("Ok(())", "Ok(())")]
    if re.match(r"((\w+::)*Result<|io::Result<)", kind):
        return [("Ok(Default::default())", "Ok(Default::default())")]
    return [("Default::default()", "Default::default()")]


def literals(token):
    """Changed values of a number, with its suffix."""
    number = re.fullmatch(r"([0-9][0-9_]*)([iu](?:8|16|32|64|128|size))?", token)
    if number:
        value, suffix = int(number[1].replace("_", "")), number[2] or ""
        return [f"{v}{suffix}" for v in ([1] if value == 0 else [value + 1, value - 1])]
    number = re.fullmatch(r"([0-9][0-9_]*\.[0-9_]*(?:[eE][-+]?[0-9]+)?|[0-9]+[eE][-+]?[0-9]+)_?(f32|f64)?", token)
    if number:
        value, suffix = float(number[1].replace("_", "")), number[2] or ""
        changed = [1.0] if value == 0 else [0.0, 2.0] if value == 1 else [value * 2, value + 1]
        return [f"{v!r}{suffix}" for v in changed]
    return []


def ancestors(node):
    while node.parent is not None:
        node = node.parent
        yield node


def type_name(node):
    if node is None:
        return "?"
    if node.type in ("generic_type", "reference_type"):
        return type_name(node.child_by_field_name("type"))
    if node.type == "scoped_type_identifier":
        return node.child_by_field_name("name").text.decode()
    return text(node)


def function_of(node):
    """The function that a node stands in, as `Type::function`, or none where no switch can stand."""
    names, inside = [], False
    child = node
    for up in ancestors(node):
        if up.type in CONSTANT or up.type.endswith("_pattern") and up.type != "match_pattern":
            return None
        if up.type == "match_pattern" and child != up.child_by_field_name("condition"):
            return None
        if up.type == "array_expression" and child == up.child_by_field_name("length"):
            return None
        if up.type == "function_item":
            modifiers = [c for c in up.children if c.type == "function_modifiers"]
            if any("const" in m.text.decode().split() for m in modifiers):
                return None
            names.append(up.child_by_field_name("name").text.decode())
            inside = True
        elif up.type == "impl_item":
            names.append(type_name(up.child_by_field_name("type")))
        elif up.type == "trait_item":
            names.append(up.child_by_field_name("name").text.decode())
        child = up
    return "::".join(reversed(names)) if inside else None


def conditional(root):
    """Ranges that `#[cfg(…)]` governs, and the modules in other files that it does."""
    ranges, modules = [], set()
    stack = [root]
    while stack:
        node = stack.pop()
        stack.extend(node.children)
        if node.type == "attribute_item" and re.match(rb"#\s*\[\s*(cfg\s*\(|test\s*\])", node.text):
            item = node.next_named_sibling
            while item is not None and item.type in ("attribute_item", *COMMENTS):
                item = item.next_named_sibling
            if item is not None:
                ranges.append((item.start_byte, item.end_byte))
                if item.type == "mod_item" and item.child_by_field_name("body") is None:
                    modules.add(item.child_by_field_name("name").text.decode())
    return ranges, modules


def sites_of_node(node, function):
    """Kind, form, original, mutated and code of each mutant of this node."""
    kind = node.type
    if kind == "binary_expression" or kind == "compound_assignment_expr":
        left, operator, right = (node.child_by_field_name(f) for f in ("left", "operator", "right"))
        sign = operator.text.decode()
        equals = "=" if kind == "compound_assignment_expr" else ""
        for other in OPERATORS.get(sign.removesuffix("=") if equals else sign, []):
            other += equals
            original, mutated = text(node, (operator, other))
            operands = [n.text.decode() for n in (left, right)]
            if not equals:
                operands = [f"({o})" if n.child_count else o for o, n in zip(operands, (left, right))]
            yield "operator", "expression", original, mutated, f"{operands[0]} {other} {operands[1]}"
    elif kind == "unary_expression" and node.children[0].type == "!":
        original, mutated = text(node, (node.children[0], ""))
        yield "not", "expression", original, mutated, node.children[1].text.decode()
    elif kind in ("integer_literal", "float_literal"):
        if node.parent.type == "field_expression":
            return
        context = node
        while context.parent.type in AROUND and (context.end_byte - context.start_byte < 12 or context.type == "arguments"):
            context = context.parent
        for other in literals(node.text.decode()):
            original, mutated = text(context, (node, other))
            yield "number", "expression", original, mutated, other
    elif kind == "expression_statement" and node.children[-1].type == ";":
        call = node.children[0]
        while call.type == "try_expression":
            call = call.children[0]
        if call.type == "call_expression":
            yield "call", "statement", text(node), "", ""
    elif kind == "function_item" and node.child_by_field_name("body") is not None:
        body, returned = node.child_by_field_name("body"), node.child_by_field_name("return_type")
        name, returned = node.child_by_field_name("name").text.decode(), "" if returned is None else text(returned)
        if body.named_child_count:
            for label, value in values_of(returned):
                if text(body) != "{" + value + "}":
                    yield "body", "body", f"fn {name}" + (f" -> {returned}" if returned else ""), label, f"return {value};"


def sites_of_file(crate, file, source):
    """The mutants of one file, its counted lines, and the modules in other files that are compiled on conditions."""
    root = PARSER.parse(source).root_node
    skipped, modules = conditional(root)
    found, lines = [], set()
    skip = lambda node: any(a <= node.start_byte and node.end_byte <= b for a, b in skipped)

    def walk(node):
        if node.type in COMMENTS or skip(node):
            return
        if node.child_count == 0:
            lines.add(node.start_point[0])
        if node.is_named:
            inner = node.child_by_field_name("body") if node.type == "function_item" else None
            for kind, form, original, mutated, code in sites_of_node(node, None):
                function = function_of(inner if inner is not None else node)
                if function is None or function.rsplit("::", 1)[-1] in NAMES_OF_TEXT:
                    break
                # A body returns behind its opening brace; a guard's replacement is added below.
                start, end = (inner.start_byte + 1,) * 2 if inner is not None else (node.start_byte, node.end_byte)
                found.append(Site(crate, file, function, kind, original, mutated, start, end, form, code))
            if node.type == "match_pattern" and (guard := node.child_by_field_name("condition")) is not None:
                function = function_of(guard)
                if function is not None and guard.type not in ("let_chain", "let_condition"):
                    for value in ("true", "false"):
                        original = "if " + text(guard)
                        found.append(
                            Site(crate, file, function, "guard", original, f"if {value}", guard.start_byte, guard.end_byte, "expression", value)
                        )
        for child in node.children:
            walk(child)

    walk(root)
    return found, len(lines), modules


def crates(root):
    """Names and folders of the crates with product code."""
    for manifest in sorted(Path(root, "crates").glob("*/Cargo.toml")):
        yield manifest.parent.name, manifest.parent


def all_sites(root, names=None, excluded=()):
    """The mutants of the crates' product code, numbered where one name occurs twice, and the counted lines by crate."""
    sites, lines = [], Counter()
    for crate, folder in crates(root):
        if names and crate not in names or crate == "mutant-switch":
            continue
        parsed, tests = {}, []
        for path in sorted(folder.glob("src/**/*.rs")):
            file = str(path.relative_to(root))
            parsed[file] = sites_of_file(crate, file, path.read_bytes())
            home = path.parent if path.stem in ("lib", "main", "mod") else path.with_suffix("")
            tests += [str((home / module).relative_to(root)) for module in parsed[file][2]]
        count = Counter()
        for file, (found, length, _) in parsed.items():
            if any(file == t + ".rs" or file.startswith(t + "/") for t in tests):
                continue
            gone = any(fnmatch.fnmatch(file.removeprefix("crates/").replace("/src/", "/", 1), e) for e in excluded)
            if not gone:
                lines[crate] += length
            for site in found:
                key = site.identity()
                site.ordinal = count[key]
                count[key] += 1
                if not gone:
                    sites.append(site)
    return sites, lines


def locate(identities, sites):
    """The present place of each name: `(site, "same" | "moved" | None)`, tried from the strictest to the loosest way."""
    ways = [
        ("same", lambda c, f, k, o, m, n: (c, f, k, o, m, n), 1),
        ("moved", lambda c, f, k, o, m, n: (c, f, k, o, m), 1),
        ("moved", lambda c, f, k, o, m, n: (f, k, o, m), 1),
        ("moved", lambda c, f, k, o, m, n: (c, f.rsplit("::")[-1], k, o, m), 1),
        ("moved", lambda c, f, k, o, m, n: (f.rsplit("::")[-1], k, o, m), 1),
        # Of a body whose function returns another type now.
        ("moved", lambda c, f, k, o, m, n: (c, f, k, o.split(" -> ")[0] if k == "body" else o, m), 1),
        # Of functions that were renamed, only where the text is long and stands once.
        ("moved", lambda c, f, k, o, m, n: (c, k, o, m), 12),
        ("moved", lambda c, f, k, o, m, n: (k, o, m), 20),
    ]
    found, taken = [None] * len(identities), set()
    for label, key, length in ways:
        index = defaultdict(list)
        for site in sites:
            if id(site) not in taken:
                index[key(*site.identity())].append(site)
        for i, identity in enumerate(identities):
            if found[i] is None and len(identity[3]) >= length:
                places = [s for s in index.get(key(*identity), []) if id(s) not in taken]
                if places and (length == 1 or len(places) == 1):
                    found[i] = (places[0], label)
                    taken.add(id(places[0]))
    return [f or (None, None) for f in found]
