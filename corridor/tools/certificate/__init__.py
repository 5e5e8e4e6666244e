"""Certificates: a statement of computed figures in a fixed form, that anyone can make anew.

made = corridor.certificate.certify("data_synthetic/dike", "asprs")
made.save("out/dike")
print(corridor.verify("out/dike/certificate.pdf", "data_synthetic/dike"))
"""

from corridor.core.registry import offered
from corridor.tools.certificate.certifying import Certificate, certify, form_names
from corridor.tools.certificate.verifying import Verified, verify

__all__ = offered(globals())
