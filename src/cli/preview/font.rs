//! Letters of 5 x 7 dots, for labels; some hang 2 dots lower.

/// Dots in a row of a letter.
pub const WIDTH: usize = 5;
/// Rows of a letter.
pub const HEIGHT: usize = 7;
/// Dots from a letter to the next.
pub const ADVANCE: usize = WIDTH + 1;

/// The letters from the space to the tilde. Each has a digit a row, in base 32, whose bits are the row's dots.
#[rustfmt::skip]
const LETTERS: [&str; 95] = [
    // space ! " # $ % & '
    "0000000", "4444404", "aa00000", "aavavaa", "4fke5u4", "op248j3", "cik8lid", "4400000",
    // ( ) * + , - . /
    "2488842", "8422248", "04lel40", "044v440", "0000c48", "000v000", "00000cc", "01248g0",
    // 0 1 2 3 4 5 6 7
    "ehjlphe", "4c4444e", "eh1248v", "v2421he", "26aiv22", "vgu11he", "68guhhe", "v124888",
    // 8 9 : ; < = > ?
    "ehhehhe", "ehhf12c", "0cc0cc0", "0cc0c48", "248g842", "00v0v00", "8421248", "eh12404",
    // @ A B C D E F G
    "ehnlnge", "ehhvhhh", "uhhuhhu", "ehggghe", "uhhhhhu", "vgguggv", "vgguggg", "ehgnhhf",
    // H I J K L M N O
    "hhhvhhh", "e44444e", "72222ic", "hikokih", "ggggggv", "hrllhhh", "hhpljhh", "ehhhhhe",
    // P Q R S T U V W
    "uhhuggg", "ehhhlid", "uhhukih", "fgge11u", "v444444", "hhhhhhe", "hhhhha4", "hhhllrh",
    // X Y Z [ \ ] ^ _
    "hha4ahh", "hha4444", "v1248gv", "e88888e", "0g84210", "e22222e", "4ah0000", "000000v",
    // ` a b c d e f g
    "8400000", "00e1fhf", "ggmphhu", "00egghe", "11djhhf", "00ehvge", "698s888", "fhhhf1e",
    // h i j k l m n o
    "ggmphhh", "40c444e", "20622ic", "ggikoki", "c44444e", "00qllhh", "00mphhh", "00ehhhe",
    // p q r s t u v w
    "mphhugg", "djhhf11", "00mpggg", "00ege1u", "88s8896", "00hhhjd", "00hhha4", "00hhlla",
    // x y z { | } ~
    "00ha4ah", "hhhhf1e", "00v248v", "6448446", "4444444", "c44244c", "008l200",
];

/// Dots that a letter hangs lower than others.
pub fn drop(c: char) -> usize {
    if "gpqy".contains(c) { 2 } else { 0 }
}

/// The rows of a letter from the top, the leftmost dot in the highest of 5 bits; `?` for what is not printable ASCII.
pub fn glyph(c: char) -> [u8; HEIGHT] {
    let index = |c: char| (c as usize).wrapping_sub(' ' as usize);
    let rows = LETTERS.get(index(c)).unwrap_or(&LETTERS[index('?')]).as_bytes();
    std::array::from_fn(|i| match rows[i] {
        digit @ b'0'..=b'9' => digit - b'0',
        letter => letter - b'a' + 10,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn letters_are_of_one_size_and_differ() {
        for (i, rows) in LETTERS.iter().enumerate() {
            assert!(
                rows.len() == HEIGHT
                    && rows.bytes().all(|b| b.is_ascii_digit() || (b'a'..=b'v').contains(&b))
            );
            assert!(LETTERS[..i].iter().all(|other| other != rows), "letter {i} is there twice");
        }
        assert_eq!(glyph(' '), [0; HEIGHT]);
        assert_eq!(glyph('L'), [16, 16, 16, 16, 16, 16, 31]);
        assert_eq!([glyph('\u{e9}'), glyph('\n'), glyph('\u{7f}')], [glyph('?'); 3]);
        // Every printable one has its place: the last is the tilde.
        assert_eq!(glyph('~'), [0, 0, 8, 21, 2, 0, 0]);
    }
}
