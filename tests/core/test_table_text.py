"""Tables are read as the spreadsheets of this world save them."""

from __future__ import annotations

import pytest

from agribot.core.table_text import decode_text, find_encoding, find_separator, read_decimal

TABLE = "name;lat;lon\nGröße;52,1;11,6\n"


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "cp1252"])
def test_a_table_is_decoded_as_its_spreadsheet_saved_it(encoding: str) -> None:
    assert decode_text(TABLE.encode(encoding)) == TABLE


@pytest.mark.parametrize("mark", ["utf-16-le", "utf-16-be"])
def test_both_orders_of_bytes_are_read_by_their_mark_and_none_is_guessed(mark: str) -> None:
    assert decode_text(("\ufeff" + TABLE).encode(mark)) == TABLE
    with pytest.raises(ValueError, match=r"holds zero bytes.*save it as CSV UTF-8"):
        decode_text(TABLE.encode(mark))


def test_a_letter_that_falls_between_two_pieces_of_a_file_stays_one() -> None:
    data = TABLE.encode()
    assert find_encoding(data[i : i + 1] for i in range(len(data))) == "utf-8"


def test_a_decimal_comma_counts_where_commas_do_not_separate() -> None:
    assert find_separator("name;lat;lon") == ";"
    assert find_separator("lat,lon") == ","
    assert read_decimal("-11,625", ";") == -11.625
    for text, separator in (("11,6", ","), ("1,000,5", ";"), ("1,000.5", ";"), ("", ";")):
        with pytest.raises(ValueError, match="could not convert"):
            read_decimal(text, separator)
