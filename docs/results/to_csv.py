#!/usr/bin/env python3
"""to_csv.py NAME FOLDER < PAGE: the Markdown tables of a page as CSV files FOLDER/NAME-*.csv.

Tables with the same first columns share a file; their headings become its first columns. A file's name ends in the kind of table
(KINDS), unless there is one kind only.
Prints the names of the files. `docs/results/make` calls it on what the measuring programs print.
"""
import csv
import re
import sys

# A table's first columns, and the end of its file's name.
KINDS = [
    (("scene", "method", "verdict"), "verdicts"),
    (("scene", "sampler", "filter", "sampler alone"), "interplay"),
    (("method", "slope over spp"), "slopes"),
    (("what", "8 spp", "seconds over"), "lights"),
    (("what", "sRGB MSE, theirs"), "foreign"),
    (("what",), "means"),
    (("scene", "%"), "planning"),
    (("scene", "sampler", "spp", "predicted / true"), "calibration"),
    (("scene", "sampler", "asked"), "stops"),
    (("safeguard",), "prices"),
    (("scene", "rays"), "rays"),
    (("scene", "triangles"), "building"),
    (("scene",), "scenes"),
]


def plain(cell):
    """A cell without Markdown."""
    cell = cell.replace("\\*", "\0")
    cell = re.sub(r"\*\*(.*?)\*\*", r"\1", cell.strip())
    cell = re.sub(r"(?<!\S)\*(\S.*?)\*(?!\S)", r"\1", cell)
    return cell.replace("`", "").replace("\0", "*").strip()


def header(line):
    names = [plain(c) for c in line.strip().strip("|").split("|")]
    for i, name in enumerate(names):
        if not name:
            names[i] = "what" if i == 0 else f"{names[i - 1]}, verdict"
        elif names.index(name) < i:
            names[i] = f"{name} ({names[i - 1]})"
    return names


def kind(names):
    for first, suffix in KINDS:
        if tuple(names[: len(first)]) == first:
            return suffix
    return "table"


def tables(lines):
    """Yields each table with the headings above it: (section, table, names, rows)."""
    section, title, i = "", "", 0
    while i < len(lines):
        line = lines[i]
        if line.startswith("## "):
            section, title = plain(line[3:]), ""
        elif line.startswith("### "):
            title = plain(line[4:])
        elif re.match(r"^\*\*.+\*\*$", line):
            title = plain(line)
        elif line.startswith("|") and i + 1 < len(lines) and re.match(r"^\|[-| :]+$", lines[i + 1]):
            names, rows, i = header(line), [], i + 2
            while i < len(lines) and lines[i].startswith("|"):
                rows.append([plain(c) for c in re.split(r"(?<!\\)\|", lines[i].strip())[1:-1]])
                i += 1
            yield section, title, names, rows
            continue
        i += 1


def main():
    name, folder = sys.argv[1:]
    files = {}
    for section, title, names, rows in tables(sys.stdin.read().splitlines()):
        columns, records = files.setdefault(kind(names), ([], []))
        columns += [n for n in names if n not in columns]
        for row in rows:
            assert len(row) == len(names), (names, row)
            records.append({"section": section, "table": title, **dict(zip(names, row))})
    for suffix, (columns, records) in files.items():
        heads = [h for h in ("section", "table") if len({r[h] for r in records}) > 1]
        alone = len(files) == 1 or suffix == name
        path = f"{folder}/{name}.csv" if alone else f"{folder}/{name}-{suffix}.csv"
        with open(path, "w", newline="") as out:
            writer = csv.DictWriter(out, heads + columns, restval="", extrasaction="ignore", lineterminator="\n")
            writer.writeheader()
            writer.writerows(records)
        print(path)

if __name__ == "__main__":
    main()
