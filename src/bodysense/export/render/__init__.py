"""Videos of a skinned, dressed and lit body, drawn without a graphics card."""
