"""Forms of certificates, each a file with TITLE and `statement(subject)`; found by their names."""
