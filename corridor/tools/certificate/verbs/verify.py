"""Make a certificate anew from its block, and compare every byte.

examples:
  corridor adjust data_synthetic/dike -o out/dike --certificate full
      makes one: certificate.html and certificate.pdf
  corridor verify out/dike/certificate.pdf data_synthetic/dike
      is it what these files give?

First the SHA-256 of each input file is compared, then the block is adjusted as the certificate says
and the certificate is made anew. The status is 0 where it is the same, 1 where it is not (every
difference is named), 2 where CERTIFICATE is not a certificate or BLOCK not a block. With other
versions of the libraries the last digits may differ: then the figures are compared to six digits,
and named.
"""

import argparse
from pathlib import Path

from corridor.core.command.options import option

OPTIONS = {
    "certificate": option("certificate.html or certificate.pdf", "CERTIFICATE", Path),
    "block": {},
}


def run(options: argparse.Namespace) -> None:
    """Verify, and say what differs."""
    from corridor.core.command.options import announce_compilation
    from corridor.core.errors import WorkFailed
    from corridor.tools.certificate import verify

    announce_compilation("half a minute", "core")
    found = verify(options.certificate, options.block)
    if not found.same:
        raise WorkFailed(" ".join(found.sentences))
    print(found)
