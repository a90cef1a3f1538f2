use super::*;
use crate::geometry::Number;

const TWO: [[f64; 3]; 2] = [[1.0, 2.0, 3.0], [-4.5, 0.001, 6.0]];

fn read(bytes: &[u8]) -> Result<Loaded, Error> {
    super::read(bytes, &ReadOptions::default(), Want::Cloud)
}

fn read_as(text: &str, options: &ReadOptions) -> Result<Vec<[f64; 3]>, Error> {
    super::read(text.as_bytes(), options, Want::Cloud).map(|l| l.verts)
}

#[track_caller]
fn refused(text: &str, parts: &[&str]) {
    let e = read_as(text, &ReadOptions::default()).unwrap_err().to_string();
    for part in parts {
        assert!(e.contains(part), "{text}: {e}");
    }
}

#[test]
fn reads_the_usual_dialects() {
    let cases: [&[u8]; 38] = [
        b"1 2 3\n-4.5 1e-3 6\n",
        b"1\t2\t3\r\n-4.5\t.001\t6.",
        b"1,2,3\n-4.5, 0.001 ,6\n",
        b"1;2;3\n-4.5; +0.001; 6\n",
        b"\xef\xbb\xbf  1   2 3\r-4.5 0.001 6\r",
        b"# comment \xff\n\n1 2 3 # here too\n// and here\n-4.5 0.001 6\n",
        b"x y z\n1 2 3\n-4.5 0.001 6\n",
        b"\"X\",\"Y\",\"Z\"\n\"1\",2,3\n-4.5,0.001,6\n",
        b"2\n1 2 3\n-4.5 0.001 6\n",
        b"1,2,3,\n-4.5,0.001,6,\n",
        b"id,x,y,z\n7,1,2,3\n8,-4.5,0.001,6\n",
        b"z y x\n3 2 1\n6 0.001 -4.5\n",
        b"# id x y z\n7 1 2 3\n8 -4.5 0.001 6\n",
        b"//X Y Z R G B\n1 2 3 0 0 0\n-4.5 0.001 6 0 0 0\n",
        b"1 2 3 word\n-4.5 0.001 6 word\n",
        // Names of programs, also in comments with another number of columns.
        b"#   POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[] as (IMAGE_ID, POINT2D_IDX)\n9 1 2 3 0 0 0 1 7 7\n\
          4 -4.5 0.001 6 0 0 0 1 5 6 7 8\n",
        b"\"Normals:0\",\"Normals:1\",\"Normals:2\",\"Points:0\",\"Points:1\",\"Points:2\"\n\
          0,0,1,1,2,3\n0,0,1,-4.5,0.001,6\n",
        b"Point,Easting,Northing,Elevation\n1,1,2,3\n2,-4.5,0.001,6\n",
        b"Point;North;East;Height\n1;2;1;3\n2;0.001;-4.5;6\n",
        b",x,y,z\n0,1,2,3\n1,-4.5,0.001,6\n",
        b",0,1,2\n0,1,2,3\n1,-4.5,0.001,6\n",
        b"0,1,2\n1,2,3\n-4.5,0.001,6\n",
        b"\t0\t1\t2\n0\t1\t2\t3\n1\t-4.5\t0.001\t6\n",
        b"Pt# East North Height\n0 1 2 3\n1 -4.5 0.001 6\n",
        b" 0 1 2\n0 1 2 3\n1 -4.5 0.001 6\n",
        b"\"1,0\",\"2,0\",\"3,0\"\n\"-4,5\",\"0,001\",\"6,0\"\n",
        b"\"x\" \"y\" \"z\"\n\"1\" 1 2 3\n\"2\" -4.5 0.001 6\n",
        b"x,y,z\nm,m,m\n1,2,3\n-4.5,0.001,6\n",
        b"X [m];Y [m];Z [m]\n1;2;3\n-4.5;0.001;6\n",
        b"A scan\nVersion 2.0\nx y z\n1 2 3\n-4.5 0.001 6\n",
        b"A scan of today\nx y z\n1 2 3\n-4.5 0.001 6\n",
        b"x,y,z\n1,2,3\nx,y,z\n-4.5,0.001,6\n",
        b"% x y z\n1 2 3\n-4.5 0.001 6\n",
        // Decimal commas, where something else separates the columns.
        b"1,0;2,0;3,0\n-4,5;0,001;6,0\n",
        b"1\t2,0\t3\n-4,5\t1,0e-3\t6\n",
        b"1,0 2,0 3,0\n-4,5 0,001 6\n",
        b"1|2|3\n-4.5|0.001|6\n",
        b"1.0D0 2 3\n-4.5 1.0d-3 6\n",
    ];
    for bytes in cases {
        let text = String::from_utf8_lossy(bytes);
        let loaded = read(bytes).unwrap_or_else(|e| panic!("{text}: {e}"));
        assert_eq!(loaded.verts, TWO, "{text}");
    }
}

#[test]
fn says_what_was_ignored() {
    assert!(read(b"1 2 3\n").unwrap().notices.is_empty());
    assert_eq!(read(b"1 2 3 4\n").unwrap().notices, ["ignored 1 extra column"]);
    assert_eq!(read(b"1 2 3 4 5\n").unwrap().notices, ["ignored 2 extra columns"]);
    let named = read(b"a,b,c\n1,2,3\n").unwrap();
    assert_eq!(named.verts, [[1.0, 2.0, 3.0]]);
    assert!(named.warnings[0].contains("first 3 columns"));
    assert!(read(b"1\n1 2 3\n4 5 6\n").unwrap().warnings[0].contains("promises 1"));
    assert!(read(b"0,1,2\n1.5,2,3\n").unwrap().warnings[0].contains("names of columns"));
    let whole = read(b"0,1,2\n1,2,3\n").unwrap();
    assert_eq!(whole.verts, [[0.0, 1.0, 2.0], [1.0, 2.0, 3.0]]);
    assert!(whole.warnings[0].contains("a point"), "{:?}", whole.warnings);
    assert!(read(b"x,y,depth\n1,2,3\n").unwrap().warnings[0].contains("mirrored"));
    assert!(read(b"x,y,z,X\n1,2,3,4\n").unwrap().warnings[0].contains("several columns"));
    assert!(read(b"1 2 3\n4 5 6 corner\n").unwrap().warnings[0].contains("first row has 3 columns"));
    let counted = read(b"1 5 5\n2 5 6\n3 7 8\n4 8 8\n").unwrap();
    assert!(counted.verts.len() == 4 && counted.warnings[0].contains("counts up"));
}

#[test]
fn counts_of_points_are_held_against_the_rows() {
    let scans = read(b"2\n1 2 3 0\n4 5 6 0\n1\n7 8 9 0\n").unwrap();
    assert_eq!(scans.verts.len(), 3);
    assert!(scans.warnings.is_empty() && scans.notices.concat().contains("joined 2 scans"));
    let wrong = read(b"3\n1 2 3\n4 5 6\n2\n7 8 9\n1 1 1\n").unwrap();
    assert_eq!(wrong.verts.len(), 4);
    assert_eq!(wrong.warnings, ["scan 1 promises 3 points, 2 are there; the file may be cut short"]);
    let short = read(b"3\n1 2 3\n4 5 6\n").unwrap();
    assert_eq!(short.warnings, ["the first line promises 3 points, 2 are there; the file may be cut short"]);
}

#[test]
fn missing_numbers_are_rows_without_a_point() {
    let rows =
        read(b"x,y,z\n1,2,3\n1,,3\nNA,2,3\n1,nan,-inf\n1.#QNAN,0,0\n-nan(ind),0,0\n1,,\n,,\n").unwrap().verts;
    assert_eq!(rows.len(), 8);
    assert!(read(b"x,y,z\n1,2,\n1,2,3\n").unwrap().warnings.is_empty());
    assert!(rows[1..].iter().all(|p| p.iter().any(|x| !x.is_finite())));
    let strict = super::read(b"1 2 3\n1 nan 3\n", &ReadOptions::default(), Want::EveryRow);
    assert!(strict.map(|l| l.verts).unwrap_err().to_string().contains("line 2: point 1: y is NaN"));
}

#[test]
fn what_is_not_certain_is_refused_with_what_to_give() {
    let rows = |row: &dyn Fn(u32) -> String| (0..9).map(row).collect::<String>();
    let survey = rows(&|i| format!("{},{}.25,{}.5,3.5,TREE\n", i + 1, 100 + i * i, 200 + i % 4));
    refused(&survey, &["counts up by one", "--columns 2,3,4"]);
    let times = rows(&|i| format!("{:.2} {}.25 {}.5 3.5\n", f64::from(i) * 0.033, i * i, i % 4));
    refused(&times, &["rises evenly", "--columns 2,3,4"]);
    let named = rows(&|i| format!("P{i} {}.25 {}.5 3.5\n", i * i, i % 4));
    refused(&named, &["column 1 holds words such as \"P0\"", "--columns 2,3,4"]);
    refused("id,a,b,c\n1,2,3,4\n", &["the columns are named \"id\", \"a\"", "--assume"]);
    refused("nx,ny,nz\n0,0,1\n", &["the columns are named"]);
    refused("lon,lat,alt\n13.5,52.5,40\n", &["angles", "project"]);
    refused("# lat lon alt\n52.5 13.5 40\n", &["angles", "project"]);
    refused("x,y,z\n1,5,2,5,3,5\n", &["3 columns are named, but the first row has 6", "semicolons"]);
    let assumed = ReadOptions { assume: true, ..Default::default() };
    assert_eq!(read_as(&survey, &assumed).unwrap()[0], [1.0, 100.25, 200.5]);
    let given = |columns: &str| ReadOptions { columns: Some(columns.parse().unwrap()), ..Default::default() };
    assert_eq!(read_as(&survey, &given("3,2,4")).unwrap()[0], [200.5, 100.25, 3.5]);
    assert_eq!(read_as(&named, &given("2,3,4")).unwrap()[2], [4.25, 2.5, 3.5]);
    assert_eq!(read_as("id,a,b,c\n1,2,3,4\n", &given("A,b,c")).unwrap(), [[2.0, 3.0, 4.0]]);
    for (columns, part) in [("a,b,d", "no column \"d\", only \"id\""), ("2,3,9", "column 9 is asked for")] {
        let e = read_as("id,a,b,c\n1,2,3,4\n", &given(columns)).unwrap_err().to_string();
        assert!(e.contains(part), "{e}");
    }
    assert!(read_as("1 2 3\n", &given("a,b,c")).unwrap_err().to_string().contains("no names of columns"));
}

#[test]
fn empty_columns_keep_their_place() {
    let nan = f64::NAN;
    let cases: [(&str, [f64; 3]); 7] = [
        // The first column of a row between tabs, in the first row and in a later one; x itself.
        ("id\tx\ty\tz\tq\n\t4\t5\t6\t9\n7\t1\t2\t3\t9\n", [4.0, 5.0, 6.0]),
        ("id\tx\ty\tz\tq\n7\t1\t2\t3\t9\n\t4\t5\t6\t9\n", [4.0, 5.0, 6.0]),
        ("x\ty\tz\n1\t2\t3\n\t5\t6\r\n", [nan, 5.0, 6.0]),
        ("x\ty\tz\ti\n4\t\t6\t7\n1\t2\t3\t7\n", [4.0, nan, 6.0]),
        // Indented rows have no empty column.
        ("\t4\t5\t6\n\t1\t2\t3\n", [4.0, 5.0, 6.0]),
        ("x\ty\tz\n\t4\t5\t6\n1\t2\t3\n", [4.0, 5.0, 6.0]),
        ("x,y,z\n,5,6\n1,2,3\n", [nan, 5.0, 6.0]),
    ];
    for (text, other) in cases {
        let points = read_as(text, &ReadOptions::default()).unwrap_or_else(|e| panic!("{text}: {e}"));
        assert_eq!(points.len(), 2, "{text}");
        let same =
            |p: &[f64; 3], q: [f64; 3]| p.iter().zip(q).all(|(a, b)| *a == b || a.is_nan() && b.is_nan());
        assert!(points.iter().any(|p| same(p, [1.0, 2.0, 3.0])), "{text}: {points:?}");
        assert!(points.iter().any(|p| same(p, other)), "{text}: {points:?}");
    }
}

#[test]
fn rows_that_lack_columns_are_refused_or_told() {
    let assumed = ReadOptions { assume: true, ..Default::default() };
    for text in [
        "id,x,y,z,q\n7,1,2,3,9\n4,5,6,9\n",
        "id,x,y,z,q\n4,5,6,9\n7,1,2,3,9\n",
        "1,2,3,9\n4,5,6\n",
        "x y z i\n1 2 3 9\n4 5 6\n",
    ] {
        refused(text, &["not certain which are missing", "--assume"]);
        assert_eq!(read_as(text, &assumed).unwrap().len(), 2, "{text}");
    }
    let loose = read(b"1 2 3 9\n4 5 6 9\n7 8 9\n").unwrap();
    assert!(
        loose.verts.len() == 3 && loose.warnings[0].contains("1 rows have fewer columns"),
        "{:?}",
        loose.warnings
    );
    // Lists of any length behind the named columns, and a delimiter behind the last one.
    let tracks = read(b"# X Y Z TRACK[] as (A, B)\n1 2 3 7 7 8\n4 5 6 7\n").unwrap();
    assert!(tracks.verts.len() == 2 && tracks.warnings.is_empty(), "{:?}", tracks.warnings);
    assert_eq!(read(b"x,y,z,i\n1,2,3,\n4,5,6,7\n").unwrap().verts.len(), 2);
}

#[test]
fn number_signs_in_columns_begin_no_comment() {
    let points =
        |text: &str| read_as(text, &ReadOptions::default()).unwrap_or_else(|e| panic!("{text}: {e}"));
    assert_eq!(points("id,x,y,z\n0,1,2,3\n#1,-4.5,0.001,6\n"), TWO);
    assert_eq!(points("x,y,z,note\n1,2,3,#a\n-4.5,0.001,6,#b\n"), TWO);
    for text in ["x,y,z\n#N/A,5,6\n1,2,3\n", "x,y,z\n1,2,3\n#DIV/0!,5,6\n", "x;y;z\n1;2;3\n4;#REF!;6\n"] {
        let read = points(text);
        assert!(read.len() == 2 && read.iter().flatten().any(|x| x.is_nan()), "{text}: {read:?}");
    }
    // Comments stay comments, also rows that were taken out by one.
    for text in ["x,y,z\n1,2,3\n#9,9,9\n-4.5,0.001,6 # b, c\n", "x,y,z\n#9,9,9\n1,2,3\n-4.5,0.001,6\n"] {
        assert_eq!(points(text), TWO, "{text}");
    }
}

#[test]
fn lines_are_skipped_and_delimiters_given() {
    let options = ReadOptions { skip: 2, delimiter: Some(b':'), ..Default::default() };
    assert_eq!(read_as("made 2024 by\nhand 3 4\n1:2:3\n-4.5:0.001:6\n", &options).unwrap(), TWO);
    let e = read_as("a\nb\n1:2:3\n4:5\n", &options).unwrap_err();
    assert_eq!(e.line(), Some(4), "{e}");
    let tabs = ReadOptions { delimiter: Some(b'\t'), ..Default::default() };
    assert_eq!(read_as("1\t\t2\t3\n", &tabs).unwrap()[0][2], 2.0);
}

#[test]
fn named_columns_are_normals() {
    let cases: [&[u8]; 3] = [
        b"x,y,z,nx,ny,nz\n1,2,3,0,0.6,-.8\n-4.5,0.001,6,1,0,0\n",
        b"# X Y Z NX NY NZ\n1 2 3 0 0.6 -.8\n-4.5 0.001 6 1 0 0\n",
        b"nz;ny;nx;id;z;y;x\n-.8;0.6;0;7;3;2;1\n0;0;1;8;6;0.001;-4.5\n",
    ];
    for bytes in cases {
        let loaded = read(bytes).unwrap();
        assert_eq!(loaded.verts, TWO);
        assert_eq!(loaded.normals, [[0.0, 0.6, -0.8], [1.0, 0.0, 0.0]], "{}", String::from_utf8_lossy(bytes));
    }
    assert!(read(b"1 2 3 0 0 1\n").unwrap().normals.is_empty());
    let odd = read(b"x y z nx ny nz\n1 2 3 0 one\n").map(|l| l.normals);
    assert!(odd.is_err() || odd.is_ok_and(|n| n.is_empty()), "names that do not fit give no normals");
    let odd = read(b"x,y,z,nx,ny,nz\n1,2,3,0,one,2\n").unwrap();
    assert!(odd.normals[0][1].is_nan());
}

#[test]
fn errors_name_the_line_and_the_point() {
    let cases: [(&[u8], u64, &str); 10] = [
        (b"1 2 3\n1 2\n", 2, "3 numbers expected, 2 found"),
        (b"1,2,3\n1,\n", 2, "3 numbers expected, 1 found"),
        (b"1 2 3\n\n1 2 abc\n", 3, "\"abc\" is not a number"),
        (b"1 2 3\n1,5;2,5;3,5\n", 2, "is not a number; write numbers with a decimal point"),
        (b"1;2;3\n1,5;2,5;3,5\n", 2, "\"1,5\" is not a number; write numbers with a decimal point"),
        (b"1 2 3\n1,2,3 4 5\n", 2, "\"1,2,3\" is not a number"),
        (b"1 2 3\n1 x 3\n", 2, "not a number"),
        (b"1 2 3\n1 1e60 3\n", 2, "not a finite"),
        (b"x y z\na b c\n", 2, "is not a number"),
        (b"id x y z\n1 1 2 3\n1 2 3\n", 3, "4 numbers expected, 3 found"),
    ];
    for (bytes, line, message) in cases {
        let e = read(bytes).map(|l| l.verts).unwrap_err();
        let text = String::from_utf8_lossy(bytes);
        assert_eq!(e.line(), Some(line), "{text}: {e}");
        assert!(e.to_string().contains(message), "{text}: {e}");
        assert!(e.element().unwrap().starts_with("point "), "{text}: {e}");
        assert!(e.advice().is_some(), "{text}: {e}");
    }
    let e = read(b"\xff\xfe1\x00").map(|l| l.verts).unwrap_err();
    assert!(e.to_string().contains("UTF-16"), "{e}");
    assert!(read(b"1\x00 \x002\x00").map(|l| l.verts).unwrap_err().to_string().contains("UTF-16"));
}

#[test]
fn named_columns_become_attributes() {
    let found = |text: &str, options: &ReadOptions| {
        let loaded = super::read(text.as_bytes(), options, Want::Attributes).unwrap();
        let values: Vec<_> = loaded.attributes.into_iter().map(|a| (a.name, a.number, a.values)).collect();
        (values, loaded.notices)
    };
    let text = "id,x,y,z,R,G,B,Label,time,note,share\n1,0.5,2,3,255,0,7,-4,1e9,wall,0.1\n\
                2,4,5,6,0,1,2,70000,1000000000.25,roof,\n";
    let (values, notices) = found(text, &ReadOptions::default());
    let expected: [(&str, Number, [f64; 2]); 7] = [
        ("id", Number::U8, [1.0, 2.0]),
        ("red", Number::U8, [255.0, 0.0]),
        ("green", Number::U8, [0.0, 1.0]),
        ("blue", Number::U8, [7.0, 2.0]),
        ("Label", Number::I32, [-4.0, 70_000.0]),
        ("time", Number::F64, [1e9, 1_000_000_000.25]),
        ("share", Number::F32, [0.1, f64::NAN]),
    ];
    assert_eq!(values.len(), expected.len());
    for ((name, number, values), wanted) in values.iter().zip(expected) {
        assert_eq!((name.as_str(), *number, values[0]), (wanted.0, wanted.1, wanted.2[0]));
        assert!(values[1].to_bits() == wanted.2[1].to_bits() || values[1].is_nan() && wanted.2[1].is_nan());
    }
    assert_eq!(notices, ["the columns \"note\" hold no numbers"]);
    // The numbers of rows may have no name; columns without any have no names for attributes.
    let labelled = found("x y z i\na 1 2 3 4\nb 5 6 7 8\n", &ReadOptions::default()).0;
    assert_eq!(labelled, [("i".to_string(), Number::U8, vec![4.0, 8.0])]);
    let named = ReadOptions { columns: Some("E,N,H".parse().unwrap()), ..Default::default() };
    let text = "N;E;H;q\n1;2;3;0.5\n4;5;6;0.25\n";
    assert_eq!(found(text, &named).0, [("q".to_string(), Number::F32, vec![0.5, 0.25])]);
    assert!(found("1 2 3 4\n5 6 7.5 8\n", &ReadOptions { assume: true, ..Default::default() }).0.is_empty());
}
