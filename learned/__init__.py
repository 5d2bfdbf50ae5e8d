"""Networks that learn canonical forms.

``methods`` has the rows of the tables and ``models`` the named networks on disk: ``paper_network``,
``code_network`` and ``field_network``. ``images`` and ``surface`` lead from and to depth images,
``field`` from and to complete surfaces. ``fitting`` trains a model on ``pairs`` by the loop in
``training``.
"""
